"""`python -m twolink`: the command line."""

from twolink.cli.app import main

if __name__ == "__main__":
    main()
