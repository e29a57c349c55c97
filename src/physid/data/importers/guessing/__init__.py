"""A mapping proposed from the names and values of a log."""

from physid.data.importers.guessing.mapping import guess_mapping as guess_mapping
