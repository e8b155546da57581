"""`python -m tcfit_app` is `tcfit`."""

import sys

from tcfit_app.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
