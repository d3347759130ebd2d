"""Examples: `yasps run NAME` or `python -m yasps.examples.NAME`."""
