"""Shared memory between guard and runner: the newest targets one way, the newest state and mode the other way.

NumPy and the standard library only. Linux: files in /dev/shm, locks of open files.
"""
