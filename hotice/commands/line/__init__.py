"""The words of the command line: which commands there are, their options, their help."""
