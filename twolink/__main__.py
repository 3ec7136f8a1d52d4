"""`python -m twolink`: the command line."""

from twolink.cli import main

if __name__ == "__main__":
    main()
