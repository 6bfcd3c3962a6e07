"""ROS 2 lifecycle node (managed node), driven by other nodes.

=============== ==========================================================================
unconfigured    publishes and serves only the lifecycle interface
inactive        configured, latched topics are published; after a transition from *active* the
                last constraint is on hold and nothing follows, which a controller treats as loss
                of the node
active          publishes
finalized       as unconfigured, permanently
=============== ==========================================================================
"""

import threading
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol, cast

from rclpy.client import Client
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import get_logger
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription

from app.bridge.node import RosNode
from app.bridge.ros_errors import reason_of
from app.geometry import MarginGuardError

_SHUTDOWN_TIMEOUT_S = 10.0
"""Longest wait of `LifecycleRosNode.close` for the node's thread, which may be configuring."""


class Managed(Protocol):
    """Transition callbacks of a lifecycle node, called in the node's thread.

    A `MarginGuardError` refuses the transition: the state does not change. Endpoints that
    `configure` created and did not destroy are destroyed after `clean_up` or a failed `configure`.
    """

    def configure(self, ros: RosNode) -> None:
        """Load everything, create publishers and services; release all of it on failure."""

    def activate(self) -> None:
        """Start publishing."""

    def deactivate(self) -> None:
        """Publish a last constraint on hold and stop publishing."""

    def clean_up(self) -> None:
        """Release everything that `configure` created."""


class LifecycleRosNode(RosNode):
    """A `RosNode` whose state is changed with ``~/change_state`` (``ros2 lifecycle set``).

    A transition that is invalid in the current state gets the reply ``success: false``. An
    unexpected exception is logged and returns the node to *unconfigured*, cleaned up. `close`
    first shuts down an active node, whose last constraint is then on hold.
    """

    def __init__(
        self,
        name: str,
        managed: Managed,
        *,
        namespace: str = "",
        domain_id: int | None = None,
    ) -> None:
        self.managed = managed
        super().__init__(
            name,
            namespace=namespace,
            domain_id=domain_id,
            make_node=partial(_StateMachine, owner=self),
        )
        self.on_close(self._shut_down)

    def _shut_down(self) -> None:
        done = threading.Event()

        def shut_down() -> None:
            try:
                cast(LifecycleNode, self.node).trigger_shutdown()
            except RuntimeError as error:  # it is already shut down
                self.node.get_logger().debug(str(error))
            finally:
                done.set()

        self.call_soon(shut_down)
        done.wait(_SHUTDOWN_TIMEOUT_S)


class _StateMachine(LifecycleNode):
    def __init__(self, name: str, *, owner: LifecycleRosNode, **options: Any) -> None:
        self._owner = owner
        self._log = get_logger(name)
        self._before: frozenset[Any] = frozenset()
        super().__init__(name, **options)
        change_state = self._service_change_state.callback
        self._service_change_state.callback = partial(self._change_state, change_state)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._before = self._endpoints()
        result = self._run(lambda: self._owner.managed.configure(self._owner))
        if result is not TransitionCallbackReturn.SUCCESS:
            self._destroy_new_endpoints()
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._run(self._owner.managed.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._run(self._deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._run(self._clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._run(lambda: self._release(state.label))

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._run(lambda: self._release(state.label))

    def _release(self, state: str) -> None:
        if state == "active":
            self._deactivate()
        if state in ("active", "inactive"):
            self._clean_up()

    def _deactivate(self) -> None:
        self._owner.managed.deactivate()
        self._owner.flush()  # deliver the last constraint before its publisher may be destroyed

    def _clean_up(self) -> None:
        self._owner.managed.clean_up()
        self._destroy_new_endpoints()

    def _endpoints(self) -> frozenset[Any]:
        return frozenset(
            (*self.publishers, *self.subscriptions, *self.services, *self.clients, *self.timers)
        )

    def _destroy_new_endpoints(self) -> None:
        """Destroy the endpoints that were created since `on_configure` began."""
        for endpoint in self._endpoints() - self._before:
            if isinstance(endpoint, Publisher):
                self._owner.destroy_publisher(endpoint)
            elif isinstance(endpoint, Subscription):
                self._owner.destroy_subscription(endpoint)
            elif isinstance(endpoint, Service):
                self.destroy_service(endpoint)
            elif isinstance(endpoint, Client):
                self.destroy_client(endpoint)
            else:
                self.destroy_timer(endpoint)

    def _run(self, action: Callable[[], None]) -> TransitionCallbackReturn:
        # rclpy turns an exception of a callback into ERROR without logging it.
        try:
            action()
        except MarginGuardError as error:
            self._log.error(f"transition refused: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # the state machine needs a result for any failure
            self._log.error(f"transition failed: {type(error).__name__}: {error}")
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _change_state(
        self, change_state: Callable[[Any, Any], Any], request: Any, response: Any
    ) -> Any:
        # rcl raises for an invalid transition; without a reply the caller would wait.
        try:
            return change_state(request, response)
        except RuntimeError as error:
            self._log.warning(f"transition {request.transition.id} refused: {reason_of(error)}")
            response.success = False
            return response
