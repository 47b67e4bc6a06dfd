"""Pipelines: graphs of commands in a YAML file, run here or on a Ray cluster."""
