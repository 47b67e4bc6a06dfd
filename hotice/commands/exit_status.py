"""Exit statuses of the command line beside 0 (done), 1 (a check failed) and 2 (an error that the user can mend)."""

STOPPED = 75
"""Of a run that was asked to stop and has saved: to be gone on with (EX_TEMPFAIL of sysexits.h)."""
INTERRUPTED = 130
"""After Ctrl-C where nothing was saved: 128 and the number of SIGINT, as shells have it."""
