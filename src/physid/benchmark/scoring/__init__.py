"""Opening the labels of a bank: verdicts judged, compared with baselines, reported."""

from physid.benchmark.scoring.calibration import calibrate as calibrate
from physid.benchmark.scoring.calibration import earlier_table as earlier_table
from physid.benchmark.scoring.calibration import spend as spend
from physid.benchmark.scoring.results import columns as columns
from physid.benchmark.scoring.results import report as report
from physid.benchmark.scoring.scoring import score as score
