"""The commands of `sumo-adas`, grouped by subject; `analysis.cli` assembles them."""
