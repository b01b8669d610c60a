"""The report page: what a run, a campaign or a recorded drive holds, as one HTML file for any browser."""
