"""The commands of `sumo-adas`, by what they work on; `analysis.cli` puts them together."""
