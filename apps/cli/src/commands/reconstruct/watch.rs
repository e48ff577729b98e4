//! `--view`: shows the training in a browser, in builds with the viewer.

use crate::training_page::TrainingPage;
use anyhow::Result;
use clap::Args;
use weather_magician::train::session::TrainStart;

/// Options of the training's page.
#[cfg(feature = "viewer")]
#[derive(Args, Clone, Debug)]
pub(crate) struct WatchArgs {
    /// Show the training in a browser: loss, PSNR and a picture every few seconds
    #[arg(long, help_heading = "Server")]
    view: bool,
    #[command(flatten)]
    server: crate::viewer::server::ServerArgs,
}

#[cfg(feature = "viewer")]
impl WatchArgs {
    /// Checks the options before the work.
    pub(crate) fn check(&self) -> Result<()> {
        self.server.guard().map(drop)
    }

    /// Returns true if the training is to be shown.
    pub(crate) fn is_asked(&self) -> bool {
        self.view
    }

    /// Starts to serve the page of a training, if it is to be shown.
    pub(crate) fn page(
        &self,
        dataset: String,
        start: &TrainStart<'_>,
    ) -> Result<Option<Box<dyn TrainingPage>>> {
        if !self.view {
            return Ok(None);
        }
        let page = crate::viewer::training::ServedTraining::serve(&self.server, dataset, start)?;
        Ok(Some(Box::new(page)))
    }
}

/// No options: this program has no viewer.
#[cfg(not(feature = "viewer"))]
#[derive(Args, Clone, Debug)]
pub(crate) struct WatchArgs {}

#[cfg(not(feature = "viewer"))]
impl WatchArgs {
    pub(crate) fn check(&self) -> Result<()> {
        Ok(())
    }

    pub(crate) fn is_asked(&self) -> bool {
        false
    }

    pub(crate) fn page(&self, _: String, _: &TrainStart<'_>) -> Result<Option<Box<dyn TrainingPage>>> {
        Ok(None)
    }
}
