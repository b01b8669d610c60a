"""The protocols, one TOML file each with all values of its tests."""
