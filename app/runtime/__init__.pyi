from .content import SessionContent, content_of

__all__ = [
    "SessionContent",
    "content_of",
]
