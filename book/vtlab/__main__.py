"""Command line: python -m vtlab run | verify | reproduce, and what packages add."""

import sys

if __name__ == "__main__":
    from vtlab.cli import main  # not above: processes that compute import this file, too

    sys.exit(main())
