"""One self-contained page over any mix of fits, benchmarks and diagnoses, made from the files in their folders."""
