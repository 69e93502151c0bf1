//! Who owns the gripper, what waits for an answer, and what was answered. Pure: the loop passes in requests and outcomes, and
//! executes the returned steps.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::answer::{Answer, Outcome, Why};
use crate::channel::Asked;
use crate::client::Client;
use crate::request::{Action, Request};

/// Number of stored answers, so that a repeated request is answered but not executed again.
const KEPT: usize = 64;
/// How long answers are stored: a restarted client may begin with the same number, and must not get an old answer.
const KEPT_FOR: Duration = Duration::from_secs(10);

/// A step for the loop to execute; it reports the outcome with [`Arbiter::close`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Close and hold.
    Hold,
    /// Open.
    Release,
    /// Acknowledge the latched faults.
    Acknowledge,
    /// Take new rest pictures.
    Rezero,
    /// The minimum force while holding, newtons.
    SetFloor(f64),
}

impl Step {
    /// Whether a newer request for `other` replaces it: only one of a kind is in progress.
    const fn is_of_kind(self, other: Self) -> bool {
        matches!(
            (self, other),
            (Self::Hold | Self::Release, Self::Hold | Self::Release)
                | (Self::Acknowledge, Self::Acknowledge)
                | (Self::Rezero, Self::Rezero)
                | (Self::SetFloor(_), Self::SetFloor(_))
        )
    }
}

/// A note for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct News {
    /// Its text.
    pub text: String,
    /// Something was not done.
    pub is_warning: bool,
}

/// Takes and answers requests, and decides which client owns the gripper.
#[derive(Debug, Default)]
pub struct Arbiter {
    owner: Option<Client>,
    under_way: Vec<(Step, Vec<Asked>)>,
    answered: VecDeque<(Instant, Answer)>,
    news: Vec<News>,
}

impl Arbiter {
    /// No client owns the gripper.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Who owns the gripper.
    #[must_use]
    pub const fn owner(&self) -> Option<&Client> {
        self.owner.as_ref()
    }

    /// The notes since the last call: answers, and take-overs.
    pub fn take_news(&mut self) -> Vec<News> {
        std::mem::take(&mut self.news)
    }

    /// Takes a request. Answers it if possible; otherwise returns the step for the loop to execute.
    pub fn take(&mut self, asked: Asked) -> Option<Step> {
        let request = &asked.request;
        let is_same = |other: &Request| other.client == request.client && other.number == request.number;
        let before = |(at, answer): &&(Instant, Answer)| {
            answer.client == request.client
                && answer.number == request.number
                && answer.action == request.action
                && at.elapsed() < KEPT_FOR
        };
        if let Some((_, answer)) = self.answered.iter().find(before) {
            asked.answer(answer.clone());
            return None;
        }
        if let Some((_, waiting)) = self
            .under_way
            .iter_mut()
            .find(|(_, waiting)| waiting.iter().any(|other| is_same(&other.request)))
        {
            waiting.push(asked);
            return None;
        }
        if !self.may_ask(request) {
            let owner = self.owner.clone().map(Why::WrongOwner);
            self.reply(&asked, Outcome::Refused(owner.unwrap_or(Why::Ended)));
            return None;
        }
        let step = match request.action {
            Action::TakeOver | Action::Yield => {
                if request.action == Action::Yield && self.owner.take().is_some() {
                    let news = format!("{} no longer owns the gripper", request.client);
                    self.tell(news);
                }
                self.reply(&asked, Outcome::Done);
                return None;
            }
            Action::Hold => Step::Hold,
            Action::Release => Step::Release,
            Action::Acknowledge => Step::Acknowledge,
            Action::Rezero => Step::Rezero,
            Action::SetFloor { newtons } => Step::SetFloor(newtons),
        };
        self.overtake(step);
        self.under_way.push((step, vec![asked]));
        Some(step)
    }

    /// Whether this client's request is accepted; the client then owns the gripper.
    fn may_ask(&mut self, request: &Request) -> bool {
        let takes_over = request.take_over || request.action == Action::TakeOver;
        match &self.owner {
            Some(owner) if *owner == request.client => true,
            Some(owner) if takes_over => {
                let news = format!("{} took the gripper over from {owner}", request.client);
                self.tell(news);
                self.owner = Some(request.client.clone());
                true
            }
            Some(_) => false,
            None => {
                if request.action != Action::Yield {
                    self.tell(format!("{} owns the gripper", request.client));
                    self.owner = Some(request.client.clone());
                }
                true
            }
        }
    }

    /// Replaces a request of this kind in progress by a newer one.
    fn overtake(&mut self, step: Step) {
        let (same, others) = std::mem::take(&mut self.under_way)
            .into_iter()
            .partition(|(other, _)| other.is_of_kind(step));
        self.under_way = others;
        for asked in same.into_iter().flat_map(|(_, waiting): (_, Vec<Asked>)| waiting) {
            self.reply(&asked, Outcome::Refused(Why::Overtaken));
        }
    }

    /// The request in progress.
    pub fn under_way(&self) -> impl Iterator<Item = Step> + '_ {
        self.under_way.iter().map(|(step, _)| *step)
    }

    /// Whether such a step is in progress.
    #[must_use]
    pub fn waits_for(&self, step: Step) -> bool {
        self.under_way().any(|other| other.is_of_kind(step))
    }

    /// Sets the outcome of the request of this kind in progress: all clients waiting for it are answered.
    pub fn close(&mut self, step: Step, outcome: &Outcome) {
        let (same, others) = std::mem::take(&mut self.under_way)
            .into_iter()
            .partition(|(other, _)| other.is_of_kind(step));
        self.under_way = others;
        for asked in same.into_iter().flat_map(|(_, waiting): (_, Vec<Asked>)| waiting) {
            self.reply(&asked, outcome.clone());
        }
    }

    fn tell(&mut self, text: String) {
        self.news.push(News {
            text,
            is_warning: false,
        });
    }

    fn reply(&mut self, asked: &Asked, outcome: Outcome) {
        let took_ms = asked.at.elapsed().as_secs_f64() * 1e3;
        let answer = Answer::to(&asked.request, outcome, self.owner.as_ref(), took_ms);
        asked.answer(answer.clone());
        self.news.push(News {
            text: answer.to_string(),
            is_warning: !answer.is_done(),
        });
        // Who was not listened to may ask again under the same number.
        if !matches!(answer.why(), Some(Why::WrongOwner(_))) {
            self.answered.push_back((Instant::now(), answer));
        }
        while self.answered.len() > KEPT {
            self.answered.pop_front();
        }
    }
}
