"""A node with a life cycle: configured, activated, deactivated, cleaned up by other nodes.

=============== ==========================================================================
unconfigured    publishes nothing but its life cycle, serves nothing else
inactive        all is loaded; on the way here from *active* the last constraint says hold,
                then there is silence, and for a controller silence means that we are gone
active          publishes
finalized       as unconfigured, for good
=============== ==========================================================================
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import get_logger

from app.bridge.node import RosNode
from app.geometry import MarginGuardError


class Managed(Protocol):
    """What goes through the life cycle; every method is called in the node's thread.

    A `MarginGuardError` refuses the transition: the node stays in the state that it is in.
    """

    def configure(self, ros: RosNode) -> None:
        """Load everything, make publishers and services; leave nothing behind when it fails."""

    def activate(self) -> None:
        """Begin to speak."""

    def deactivate(self) -> None:
        """Fall silent, with hold as the last word."""

    def clean_up(self) -> None:
        """Give back what `configure` made."""


class LifecycleRosNode(RosNode):
    """A `RosNode` whose state others change by ``~/change_state`` (``ros2 lifecycle set``).

    A transition that is not possible in the present state is answered with ``success: false``. A
    fault that nobody foresaw takes the node back to *unconfigured*, cleaned up and said in the log.
    """

    def __init__(
        self,
        name: str,
        managed: Managed,
        *,
        namespace: str = "",
        ros_args: Sequence[str] = (),
        domain_id: int | None = None,
    ) -> None:
        self.managed = managed
        super().__init__(
            name,
            namespace=namespace,
            ros_args=ros_args,
            domain_id=domain_id,
            make_node=partial(_StateMachine, owner=self),
        )


class _StateMachine(LifecycleNode):
    def __init__(self, name: str, *, owner: LifecycleRosNode, **options: Any) -> None:
        self._owner = owner
        self._log = get_logger(name)
        super().__init__(name, **options)
        serve = self._service_change_state.callback
        self._service_change_state.callback = partial(self._answered, serve)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._done(lambda: self._owner.managed.configure(self._owner))

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._done(self._owner.managed.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._done(self._owner.managed.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._done(self._owner.managed.clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._done(lambda: self._end(state.label))

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._done(lambda: self._end(state.label))

    def _end(self, before: str) -> None:
        if before == "active":
            self._owner.managed.deactivate()
        if before in ("active", "inactive"):
            self._owner.managed.clean_up()

    def _done(self, action: Callable[[], None]) -> TransitionCallbackReturn:
        # rclpy takes whatever a callback raises for an error and tells nobody.
        try:
            action()
        except MarginGuardError as error:
            self._log.error(f"transition refused: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # whatever it is, the state machine must know
            self._log.error(f"transition failed: {type(error).__name__}: {error}")
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _answered(self, serve: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
        # A transition that the state does not know raises in rcl, and the caller would wait.
        try:
            return serve(request, response)
        except RuntimeError as error:
            reason = " ".join(str(error).split())
            self._log.warning(f"transition {request.transition.id} refused: {reason}")
            response.success = False
            return response
