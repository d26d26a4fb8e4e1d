"""What `bayesdamp look` shows: a page, a small plot, and words."""
