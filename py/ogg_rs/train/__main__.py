"""Entry of `python -m ogg_rs.train`."""

from .cli import main

raise SystemExit(main())
