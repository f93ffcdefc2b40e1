"""`python -m workbench`: the command line without the script on the path."""

try:
    from workbench.cli import main
except KeyboardInterrupt:  # before the program is there to hear it
    raise SystemExit(130) from None

if __name__ == "__main__":
    main()
