//! Messages to the user.

/// Kind of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Confirmation or note; disappears by itself.
    Done,
    /// Error; stays until dismissed.
    Error,
}

/// One message.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Message {
    pub kind: Kind,
    pub text: String,
    /// Number of successive repetitions.
    pub count: u32,
    pub last_s: f64,
}

/// The messages on the screen, oldest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct Messages(Vec<Message>);

impl Messages {
    /// Display time of a confirmation, seconds.
    pub(crate) const DONE_S: f64 = 6.0;
    /// Maximum number of messages: more would hide the frame.
    const MAX_SHOWN: usize = 5;

    /// Adds a message, or increments the count of an equal one.
    pub(crate) fn add(&mut self, kind: Kind, text: impl Into<String>, now_s: f64) {
        let text = text.into();
        if let Some(same) = self.0.iter_mut().find(|m| m.kind == kind && m.text == text) {
            same.count += 1;
            same.last_s = now_s;
            return;
        }
        if self.0.len() == Self::MAX_SHOWN {
            self.0.remove(0);
        }
        self.0.push(Message {
            kind,
            text,
            count: 1,
            last_s: now_s,
        });
    }

    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = &Message> {
        self.0.iter()
    }

    /// Removes one message.
    pub(crate) fn dismiss(&mut self, index: usize) {
        if index < self.0.len() {
            self.0.remove(index);
        }
    }

    /// Removes all messages.
    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }

    /// Removes messages whose display time is over; returns the seconds until the next one expires.
    pub(crate) fn expire(&mut self, now_s: f64) -> Option<f64> {
        let left = |m: &Message| m.last_s + Self::DONE_S - now_s;
        self.0.retain(|m| m.kind == Kind::Error || left(m) > 0.0);
        self.0
            .iter()
            .filter(|m| m.kind == Kind::Done)
            .map(left)
            .min_by(f64::total_cmp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_stay_and_notes_expire() {
        let mut messages = Messages::default();
        messages.add(Kind::Error, "broken", 0.0);
        messages.add(Kind::Done, "saved", 1.0);
        assert_eq!(messages.expire(2.0), Some(Messages::DONE_S - 1.0));
        assert_eq!(messages.expire(100.0), None);
        assert_eq!(
            messages.iter().map(|m| m.text.as_str()).collect::<Vec<_>>(),
            ["broken"]
        );
        messages.dismiss(0);
        messages.dismiss(0);
        assert_eq!(messages.iter().len(), 0);
    }

    #[test]
    fn repeats_are_counted_and_messages_bounded() {
        let mut messages = Messages::default();
        (0..1000).for_each(|i| messages.add(Kind::Error, "no", f64::from(i)));
        assert_eq!(messages.iter().map(|m| m.count).collect::<Vec<_>>(), [1000]);
        (0..1000).for_each(|i| messages.add(Kind::Error, format!("{i}"), 0.0));
        assert_eq!(messages.iter().len(), Messages::MAX_SHOWN);
    }
}
