"""The diagnosis of a sim-to-real gap: which effect a nominal model lacks, where, and how far the gap closes with it."""

from physid.diagnosis.conclusion.metrics import figures_of
from physid.diagnosis.document.document import Diagnosis, read_diagnosis
from physid.diagnosis.document.sentences import summary_lines
from physid.diagnosis.progress import Progress, Stage
from physid.diagnosis.report.overlay import FILM
from physid.diagnosis.report.page import REPORT
from physid.diagnosis.settings.settings import Settings, parse_changes

__all__ = [
    "FILM",
    "REPORT",
    "Diagnosis",
    "Progress",
    "Settings",
    "Stage",
    "figures_of",
    "parse_changes",
    "read_diagnosis",
    "summary_lines",
]
