"""`hotice deploy`: guard and runner as processes, and what its operator sees and types."""
