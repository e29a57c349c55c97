"""Whether recordings can be trusted: what they measure of themselves, and what looks like a mistake."""
