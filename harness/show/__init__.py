"""Looking at episodes: replays as text, and figures."""
