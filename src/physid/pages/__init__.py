"""What all pages share: one stylesheet, templates, numbers as people read them, figures in its colours."""
