"""Command line of hotice, also as `python -m hotice.learn`."""
