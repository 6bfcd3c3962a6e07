"""Values of the page about the recording of a live session."""

from app.runtime import RecordingStatus


def recording_values(status: RecordingStatus | None) -> dict[str, object] | None:
    """Values of the last recording; None before the first."""
    if status is None:
        return None
    minutes, seconds = divmod(int(status.duration_s), 60)
    return {
        "active": status.active,
        "time": f"{minutes}:{seconds:02d}",
        "messages": f"{status.messages} messages",
        "lost": status.lost_text,
        "is_lossy": bool(status.lost),
        "folder": str(status.folder),
        "waiting": ", ".join(status.waiting),
        "problem": status.problem,
    }
