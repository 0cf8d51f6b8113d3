"""The paper's car: chart, key points, wheels."""
