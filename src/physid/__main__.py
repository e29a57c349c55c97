"""`python -m physid` does what `physid` does."""

from physid.cli import program

if __name__ == "__main__":
    program()
