"""Chart, key points and wheels of the paper's car."""
