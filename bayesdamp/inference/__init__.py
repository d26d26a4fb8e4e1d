"""From a record and seeds to posteriors and evidence."""
