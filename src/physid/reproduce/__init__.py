"""The paper's experiments, cell by cell, and what they measure beside the paper's figures."""
