"""The paper's study: its grid, jobs, results, claims, figures, tables and report."""
