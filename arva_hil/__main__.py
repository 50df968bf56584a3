"""`python -m arva_hil` is `arva-hil`."""

import sys

from arva_hil.cli.main import main

sys.exit(main())
