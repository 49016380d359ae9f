"""`python -m ogg_rs` is the `ogg` command."""

from ._command import main

if __name__ == "__main__":
    main()
