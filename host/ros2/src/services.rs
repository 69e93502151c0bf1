//! The services that ask the gripper for something: a thread each, so that a request which takes long keeps no hold waiting, and
//! the requests of one service stay in their order.

use std::io;
use std::pin::pin;
use std::thread;

use futures::StreamExt as _;
use futures::channel::oneshot;
use futures::executor::block_on;
use futures::future::{Either, FutureExt as _, Shared, select};
use gripline_control::{Action, Handle};
use gripline_recording::ros2::{Namespace, Rmw};
use ros2_client::qos::{History, QosProfile};
use ros2_client::{Name, Node, Server, ServiceMapping, ServiceTypeName};

use crate::error::Ros2Error;
use crate::types::{Ask, ControlRequest, Response, SetFloorRequest};

/// Requests that wait for a service.
const WAITING: usize = 10;
/// Services of type `gripline_msgs/srv/Control`, by their names.
const CONTROL: [Action; 6] = [
    Action::Hold,
    Action::Release,
    Action::Acknowledge,
    Action::Rezero,
    Action::TakeOver,
    Action::Yield,
];

/// The services at work. They end soon after this is dropped; one that waits for the gripper's answer tells it first.
pub(crate) struct Services {
    _until_dropped: oneshot::Sender<()>,
}

/// Offers all services.
///
/// # Errors
/// [`Ros2Error`] when one cannot be offered.
pub(crate) fn start(
    node: &mut Node,
    namespace: &Namespace,
    rmw: Rmw,
    handle: &Handle,
) -> Result<Services, Ros2Error> {
    let (until_dropped, over) = oneshot::channel();
    let over = over.shared();
    for action in CONTROL {
        let server = server::<ControlRequest>(node, namespace, rmw, (action.name(), "Control"))?;
        spawn(server, action, handle, &over).map_err(Ros2Error::of("service", action.name()))?;
    }
    // The number is the request's.
    let floor = Action::SetFloor { newtons: 0.0 };
    let server = server::<SetFloorRequest>(node, namespace, rmw, (floor.name(), "SetFloor"))?;
    spawn(server, floor, handle, &over).map_err(Ros2Error::of("service", floor.name()))?;
    Ok(Services {
        _until_dropped: until_dropped,
    })
}

fn server<R: Ask>(
    node: &mut Node,
    namespace: &Namespace,
    rmw: Rmw,
    (name, kind): (&str, &str),
) -> Result<Server<R, Response>, Ros2Error> {
    let mapping = match rmw {
        Rmw::FastRtps => ServiceMapping::Enhanced,
        Rmw::CycloneDds => ServiceMapping::Cyclone,
    };
    let qos = QosProfile::publisher_default().history(History::KeepLast { depth: WAITING });
    let name = namespace.topic(name);
    let ros_name = Name::parse(&name).map_err(Ros2Error::of("service", &name))?;
    node.create_server(
        mapping,
        &ros_name,
        &ServiceTypeName::new("gripline_msgs", kind),
        qos.clone(),
        qos,
    )
    .map_err(Ros2Error::of("service", &name))
}

fn spawn<R: Ask>(
    server: Server<R, Response>,
    action: Action,
    handle: &Handle,
    over: &Shared<oneshot::Receiver<()>>,
) -> io::Result<()> {
    let (handle, over) = (handle.clone(), over.clone());
    thread::Builder::new()
        .name(format!("ros2 {}", action.name()))
        .spawn(move || block_on(serve(&server, action, &handle, over)))
        .map(|_| ())
}

/// Answers request after request.
async fn serve<R: Ask>(
    server: &Server<R, Response>,
    action: Action,
    handle: &Handle,
    mut over: Shared<oneshot::Receiver<()>>,
) {
    let mut requests = pin!(server.receive_request_stream());
    let mut unreadable = 0_u64;
    while let Either::Left((Some(request), _)) = select(requests.next(), &mut over).await {
        match request {
            Ok((id, asked)) => {
                let response = match asked.to_request(action) {
                    Ok(request) => Response::from(&handle.ask(&request)),
                    Err(why) => asked.refusal(&why),
                };
                // Who went away misses it.
                let _ = server.send_response(id, response);
            }
            Err(error) => {
                unreadable += 1;
                // The first one, and then whenever they have become twice as many.
                if unreadable.is_power_of_two() {
                    tracing::warn!(
                        "ROS 2 service {}: {unreadable} requests that cannot be read so far ({error}), expected those of \
                         gripline_msgs: build that package of this version, and see ros2.rmw",
                        action.name()
                    );
                }
            }
        }
    }
}
