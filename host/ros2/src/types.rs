//! Requests and responses of the services, field by field as in `gripline_msgs/srv`.

use gripline_control::{Action, Answer, BadClient, Request, Why};
use ros2_client::Message;
use serde::{Deserialize, Serialize};

/// `gripline_msgs/srv/Control`, the request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct ControlRequest {
    pub(crate) client: String,
    pub(crate) request: u64,
    pub(crate) take_over: bool,
}

/// `gripline_msgs/srv/SetFloor`, the request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct SetFloorRequest {
    pub(crate) client: String,
    pub(crate) request: u64,
    pub(crate) take_over: bool,
    /// Newtons.
    pub(crate) floor: f64,
}

/// The response of both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Response {
    pub(crate) done: bool,
    pub(crate) why: String,
    pub(crate) message: String,
    pub(crate) owner: String,
    /// Seconds.
    pub(crate) took: f64,
    pub(crate) client: String,
    pub(crate) request: u64,
}

impl Message for ControlRequest {}
impl Message for SetFloorRequest {}
impl Message for Response {}

/// A request that cannot be one.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum BadRequest {
    #[error(transparent)]
    Client(#[from] BadClient),
    #[error("floor: found {0}, expected newtons")]
    Floor(f64),
}

/// What a service is asked for.
pub(crate) trait Ask: Message + Clone + Send + 'static {
    /// The request, `action` being what the service is for.
    ///
    /// # Errors
    /// [`BadRequest`], which names the field.
    fn to_request(&self, action: Action) -> Result<Request, BadRequest>;

    /// The answer to a request that cannot be one.
    fn refusal(&self, why: &BadRequest) -> Response;
}

impl Ask for ControlRequest {
    fn to_request(&self, action: Action) -> Result<Request, BadRequest> {
        Ok(Request {
            client: self.client.parse()?,
            number: self.request,
            action,
            take_over: self.take_over,
        })
    }

    fn refusal(&self, why: &BadRequest) -> Response {
        refusal(&self.client, self.request, why)
    }
}

impl Ask for SetFloorRequest {
    fn to_request(&self, _: Action) -> Result<Request, BadRequest> {
        if !self.floor.is_finite() {
            return Err(BadRequest::Floor(self.floor));
        }
        Ok(Request {
            client: self.client.parse()?,
            number: self.request,
            action: Action::SetFloor { newtons: self.floor },
            take_over: self.take_over,
        })
    }

    fn refusal(&self, why: &BadRequest) -> Response {
        refusal(&self.client, self.request, why)
    }
}

fn refusal(client: &str, request: u64, why: &BadRequest) -> Response {
    Response {
        done: false,
        why: "bad_request".to_owned(),
        message: why.to_string(),
        owner: String::new(),
        took: 0.0,
        // What was sent may be long.
        client: client.chars().take(64).collect(),
        request,
    }
}

impl From<&Answer> for Response {
    fn from(answer: &Answer) -> Self {
        Self {
            done: answer.is_done(),
            why: answer.why().map_or("", Why::name).to_owned(),
            message: answer.to_string(),
            owner: answer.owner.as_ref().map_or("", |owner| owner.name()).to_owned(),
            took: answer.took_ms / 1e3,
            client: answer.client.to_string(),
            request: answer.number,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use ros2_client::dds::rustdds::RepresentationIdentifier;
    use ros2_client::dds::rustdds::serialization::deserialize_from_cdr_with_rep_id;

    use super::*;

    #[test]
    fn what_is_no_request_is_refused_by_the_name_of_its_field() {
        let bad = ControlRequest {
            client: "two words".to_owned(),
            request: 3,
            take_over: false,
        };
        let why = bad.to_request(Action::Hold).unwrap_err();
        let response = bad.refusal(&why);
        assert_eq!((response.done, response.why.as_str()), (false, "bad_request"));
        assert!(response.message.starts_with("client: found "), "{response:?}");
        for floor in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let bad = SetFloorRequest {
                client: "a".to_owned(),
                request: 3,
                take_over: false,
                floor,
            };
            let why = bad.to_request(Action::Hold).unwrap_err();
            assert!(why.to_string().starts_with("floor: found "), "{why}");
        }
    }

    proptest! {
        /// Whatever bytes arrive, they are a request or an error, never a panic.
        #[test]
        fn any_bytes_are_a_request_or_an_error(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            for encoding in [RepresentationIdentifier::CDR_LE, RepresentationIdentifier::CDR_BE] {
                if let Ok((request, _)) = deserialize_from_cdr_with_rep_id::<ControlRequest>(&bytes, encoding) {
                    let _ = request.to_request(Action::Hold).map_err(|why| request.refusal(&why));
                }
                if let Ok((request, _)) = deserialize_from_cdr_with_rep_id::<SetFloorRequest>(&bytes, encoding) {
                    let _ = request.to_request(Action::Hold).map_err(|why| request.refusal(&why));
                }
            }
        }
    }
}
