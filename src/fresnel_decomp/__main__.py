"""`python -m fresnel_decomp` is the command `fresnel-decomp`."""

from .cli import main

if __name__ == "__main__":
    main()
