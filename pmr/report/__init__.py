"""The report: one HTML page and one PDF of results, to which it adds nothing but form (`pmr.report.document`)."""
