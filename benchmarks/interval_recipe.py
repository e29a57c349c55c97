"""How often 90 % intervals hold the truth, by recipe: the table of docs/decisions/0053-intervals.md.

    python benchmarks/interval_recipe.py

An estimate is disturbed by f times the variance that white noise would cause, and few trajectories scatter by as much,
with the chance of so many degrees of freedom. No physics: about a minute.
"""

from __future__ import annotations

import argparse
import math

import torch
from scipy.stats import chi2
from scipy.stats import t as student

from physid.estimation.least_squares.covariance import inflation, quantile
from physid.estimation.least_squares.settings import IntervalSettings

FACTORS = (1.0, 1.5, 2.0, 4.0, 10.0, 100.0, 1000.0)
FREEDOMS = (3, 5, 9, 23)
RECIPES = {
    "larger of the two, Student's": None,
    "white noise 0.5; tail 0.1": IntervalSettings(white=0.5),
    "white noise 0.3; tail 0.1": IntervalSettings(),
    "white noise 0.1; tail 0.1": IntervalSettings(white=0.1),
    "white noise 0.3; tail 1": IntervalSettings(tail=1.0),
}


def held(recipe: IntervalSettings | None, factor: float, freedom: int, draws: int) -> float:
    """Return the share of the intervals that hold the truth."""
    ratio = torch.tensor(chi2.rvs(freedom, size=draws, random_state=0)) / freedom * factor
    if recipe is None:  # the small-sample form CR3 is larger by one trajectory in all
        reach = float(student.ppf(0.95, freedom)) * (ratio * (freedom + 1) / freedom).clamp_min(1).sqrt()
    else:
        reach = quantile(0.9) * inflation(ratio, torch.full_like(ratio, freedom), recipe).sqrt()
    return float(torch.erf(reach / math.sqrt(2 * factor)).mean())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=4000)
    draws = parser.parse_args().draws
    print("| recipe | degrees of freedom |" + "".join(f" f = {factor:g} |" for factor in FACTORS))
    print("|---|---:|" + "---:|" * len(FACTORS))
    for name, recipe in RECIPES.items():
        for freedom in FREEDOMS:
            shares = "".join(f" {100 * held(recipe, factor, freedom, draws):.0f} |" for factor in FACTORS)
            print(f"| {name} | {freedom} |{shares}", flush=True)


if __name__ == "__main__":
    main()
