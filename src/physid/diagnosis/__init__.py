"""The diagnosis of a sim-to-real gap: which effect a nominal model lacks, where, and how far the gap closes with it."""

from physid.diagnosis.document.document import Diagnosis as Diagnosis
from physid.diagnosis.document.document import read_diagnosis as read_diagnosis
from physid.diagnosis.document.flat_figures import figures_of as figures_of
from physid.diagnosis.document.sentences import summary_lines as summary_lines
from physid.diagnosis.progress import Progress as Progress
from physid.diagnosis.progress import Stage as Stage
from physid.diagnosis.report.overlay import FILM as FILM
from physid.diagnosis.report.page import REPORT as REPORT
from physid.diagnosis.results import MISSING as MISSING
from physid.diagnosis.settings.settings import Settings as Settings
from physid.diagnosis.settings.settings import parse_changes as parse_changes
