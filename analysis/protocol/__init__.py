"""Test protocols of the industry: data in `standards`, one runner, the table a test house would write."""
