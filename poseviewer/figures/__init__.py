"""Pictures of numbers, for print: loss landscapes and loss curves. The only user of matplotlib."""
