//! A sense of the machine as the source of a channel.

use crate::channel::Source;
use crate::{AnySense, Kernel, SenseError};
use sk_core::prelude::*;

pub(crate) struct SenseSource {
    pub sense: Box<dyn AnySense>,
    pub kernel: Kernel,
}

impl Source for SenseSource {
    fn name(&self) -> &'static str {
        self.sense.about().name
    }
    fn doc(&self) -> &'static str {
        self.sense.about().doc
    }
    fn units(&self) -> SkVariant {
        self.sense.about().units()
    }
    fn period(&self) -> Duration {
        self.sense.about().period
    }
    fn read(&mut self, cx: &Cx) -> Result<Option<SkVariant>, SenseError> {
        self.sense.read_variant(&self.kernel, cx.now())
    }
    fn forget(&mut self) {
        self.sense.forget();
    }
}
