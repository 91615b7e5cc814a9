"""`python -m flexlab`."""

from flexlab.cli import main

if __name__ == "__main__":
    main()
