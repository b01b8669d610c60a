"""The protocols, a TOML file each: every figure of a test stands there."""
