"""What the benchmarks share: options and results of a script, rounds in alternation, a market under measurement."""
