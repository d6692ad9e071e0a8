"""`python -m plcemu` is `plcemu`."""

import sys

from plcemu.cli.main import main

sys.exit(main())
