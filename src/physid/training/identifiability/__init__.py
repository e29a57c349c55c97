"""Which parameters an experiment identifies: `physid identifiability`."""
