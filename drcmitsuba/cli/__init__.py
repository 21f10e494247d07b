"""Command line: `drcmitsuba VERB …`, one module for each group of verbs."""
