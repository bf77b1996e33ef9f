"""How are images of one's own tracked? Recordings, and their files."""
