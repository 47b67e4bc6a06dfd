"""`python -m hotice`: the command `hotice`."""

import sys

from hotice.commands.program import main

if __name__ == "__main__":
    sys.exit(main())
