"""The document of a diagnosis: diagnosis.json, checked, and what it says in sentences."""
