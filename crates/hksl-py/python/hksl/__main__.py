"""`python -m hksl`."""

import sys

from hksl._command import main

sys.exit(main())
