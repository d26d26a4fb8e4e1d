"""Read and write the folder of a run: results of tasks, tables, provenance, and the lock."""
