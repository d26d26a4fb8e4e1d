"""What a computer lends to a run: compiled programs, processes, memory."""
