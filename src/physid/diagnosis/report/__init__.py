"""The document and the page of a diagnosis: diagnosis.json, sentences, figures, HTML."""
