"""What all benchmarks share: options, child processes, figures, goals, tables, files and plots."""
