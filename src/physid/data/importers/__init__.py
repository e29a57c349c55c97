"""Recordings from elsewhere, converted to recording sets; nothing is estimated on the way."""

from physid.data.importers.convert import import_logs as import_logs
from physid.data.importers.cube_tosses import import_cube_tosses as import_cube_tosses
from physid.data.importers.finding import find_logs as find_logs
from physid.data.importers.finding import kind_of as kind_of
from physid.data.importers.guessing import guess_mapping as guess_mapping
from physid.data.importers.mapping_files import read_mapping as read_mapping
from physid.data.importers.mapping_files import with_episodes as with_episodes
from physid.data.importers.sets import Imported as Imported
