"""Define the commands, each in a module of its name, which is imported only when the command runs."""
