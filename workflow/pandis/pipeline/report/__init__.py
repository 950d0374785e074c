"""The report: tables, figures and the page for users."""
