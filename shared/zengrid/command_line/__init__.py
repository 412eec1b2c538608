"""What all commands and services share: the parser, options, values, and exit codes."""
