"""Training runs: configuration, loop, curricula, statistics, progress."""
