"""Pictures of numbers, for print: loss landscapes. The only user of matplotlib."""
