"""The nominal model against a reference simulator: replays, discrepancy, null simulations, nominal fit."""
