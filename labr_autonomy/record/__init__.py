"""What a run leaves behind: logs, figures, report."""
