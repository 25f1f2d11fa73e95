# Completions of telltale for fish: the program knows its own commands.
telltale completions fish | source
