//! The page in a browser that shows a training, as the training knows it.

use weather_magician::train::session::TrainObserver;

/// A page in a browser that shows a training.
pub(crate) trait TrainingPage: TrainObserver {
    /// Tells the page that the training is done.
    fn end(&self, text: String);
}
