"""The process that writes the bag of a replay: ``python -m app.cli.bag_process``.

It loads ROS, which takes a second, and then reads pickled messages of `app.cli.bag_writing` from
standard input: first the content, the manifest and the new folder, then what follows in the replay,
and None at its end. It writes a pickled `BagAnswer` to standard output. Without the None it ends
silently; the bag is then not complete.
"""

import pickle
import time
from typing import IO, Any

from app.cli.bag_writing import BagAnswer
from app.cli.process import GcPause
from app.files.child_process import answer_request
from app.files.extras import install_hint
from app.geometry import MarginGuardError


def main() -> None:
    """Write one bag."""
    with GcPause() as memory:
        answer_request(lambda stream: [pickle.dumps(_answered(stream, memory))])


def _answered(stream: IO[bytes], memory: GcPause) -> BagAnswer:
    try:
        import app.bridge  # noqa: F401  (slow to load: before the request arrives)
    except ImportError as error:
        return BagAnswer(f"ROS 2 cannot be loaded ({error}): {install_hint(error)}")
    memory.settle()
    try:
        return _written(stream)
    except EOFError:
        return BagAnswer("the replay ended before its last step")
    except OSError as error:
        return BagAnswer(error.strerror or str(error))
    except MarginGuardError as error:
        return BagAnswer(str(error))


def _written(stream: IO[bytes]) -> BagAnswer:
    from app.bridge import SessionBag
    from app.bridge.messages import playback_text

    content, manifest, folder = pickle.load(stream)
    with SessionBag(content, playback_text(manifest), folder) as bag:
        while (message := pickle.load(stream)) is not None:
            _act(bag, *message)
    return BagAnswer(processor_s=time.process_time())


def _act(bag: Any, name: str, value: Any) -> None:
    if name == "steps":
        for step in pickle.loads(value):
            bag.publish(step)
    elif name == "content":
        bag.use(**value)
    elif name == "latch":
        bag.latch(value)
    else:
        bag.end()


if __name__ == "__main__":
    main()
