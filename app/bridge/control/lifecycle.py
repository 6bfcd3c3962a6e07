"""A node with a life cycle: configured, activated, deactivated, cleaned up by other nodes.

=============== ==========================================================================
unconfigured    publishes nothing but its life cycle, serves nothing else
inactive        all is loaded, what is latched is said; on the way here from *active* the last
                constraint says hold, then there is silence, which to a controller means that we
                are gone
active          publishes
finalized       as unconfigured, for good
=============== ==========================================================================
"""

import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol, cast

from rclpy.client import Client
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import get_logger
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription

from app.bridge.errors import reason_of
from app.bridge.node import RosNode
from app.geometry import MarginGuardError

_END_S = 10.0
"""How long `LifecycleRosNode.close` waits for the node's thread, which may be configuring."""


class Managed(Protocol):
    """What goes through the life cycle; every method is called in the node's thread.

    A `MarginGuardError` refuses the transition: the node stays in the state that it is in.
    Endpoints of the node that `configure` made and nobody took back go with `clean_up`, or with a
    `configure` that fails.
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
    `close` shuts an active node down first: with hold as the last word.
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
        self.on_close(self._shut_down)

    def _shut_down(self) -> None:
        ended = threading.Event()

        def shut_down() -> None:
            try:
                cast(LifecycleNode, self.node).trigger_shutdown()
            except RuntimeError as error:  # it is shut down already
                self.node.get_logger().debug(str(error))
            finally:
                ended.set()

        self.call_soon(shut_down)
        ended.wait(_END_S)


class _StateMachine(LifecycleNode):
    def __init__(self, name: str, *, owner: LifecycleRosNode, **options: Any) -> None:
        self._owner = owner
        self._log = get_logger(name)
        self._before: frozenset[Any] = frozenset()
        super().__init__(name, **options)
        serve = self._service_change_state.callback
        self._service_change_state.callback = partial(self._answered, serve)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._before = self._endpoints()
        done = self._done(lambda: self._owner.managed.configure(self._owner))
        if done is not TransitionCallbackReturn.SUCCESS:
            self._take_back()
        return done

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._done(self._owner.managed.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._done(self._deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._done(self._clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._done(lambda: self._end(state.label))

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._done(lambda: self._end(state.label))

    def _end(self, before: str) -> None:
        if before == "active":
            self._deactivate()
        if before in ("active", "inactive"):
            self._clean_up()

    def _deactivate(self) -> None:
        self._owner.managed.deactivate()
        self._owner.flush()  # the last word; its publisher may be gone the next moment

    def _clean_up(self) -> None:
        self._owner.managed.clean_up()
        self._take_back()

    def _endpoints(self) -> frozenset[Any]:
        return frozenset(
            (*self.publishers, *self.subscriptions, *self.services, *self.clients, *self.timers)
        )

    def _take_back(self) -> None:
        """Destroy what was made on the node since it began to be configured."""
        for made in self._endpoints() - self._before:
            if isinstance(made, Publisher):
                self._owner.withdraw(made)
            elif isinstance(made, Subscription):
                self.destroy_subscription(made)
            elif isinstance(made, Service):
                self.destroy_service(made)
            elif isinstance(made, Client):
                self.destroy_client(made)
            else:
                self.destroy_timer(made)

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
            self._log.warning(f"transition {request.transition.id} refused: {reason_of(error)}")
            response.success = False
            return response
