"""What counts: scored trials of policies and of the walking baseline, referees, seeds, statistics, reports."""
