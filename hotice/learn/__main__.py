"""Door to the command line: `python -m hotice.learn` is `hotice`."""

import sys

from hotice.commands.program import main

if __name__ == "__main__":
    sys.exit(main())
