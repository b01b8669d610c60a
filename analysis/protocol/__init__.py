"""Standard test protocols: definitions in `standards`, one runner, and a test report."""
