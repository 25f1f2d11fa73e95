# Completions of telltale for bash: the program knows its own commands.
source <(telltale completions bash)
