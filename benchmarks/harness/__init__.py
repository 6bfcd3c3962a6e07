"""Shared parts of benchmarks: options, child processes, figures, goals, tables, files and plots."""
