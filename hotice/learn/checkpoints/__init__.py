"""Checkpoints: files, averages, merging, widening, and what a policy was trained on."""
