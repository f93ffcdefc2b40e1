"""`python -m workbench`: the command line without the script on the path."""

from workbench.cli import main

if __name__ == "__main__":
    main()
