"""Which LLVM Dr.Jit gets: `search` finds the libraries there are, `choice` decides before Dr.Jit is
imported, `fetch` gets one where none is usable. `doctor` is the public face of all three."""
