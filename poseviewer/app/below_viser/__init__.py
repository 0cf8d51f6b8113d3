"""What reaches below viser and websockets, each with the version that it was written for."""
