//! Blocks of the built-in street.

use super::*;
use crate::session::{PriorSource, SessionError, SessionOptions, StepProgress, TrainObserver};
use crate::{HeldOut, TrainPlan};
use glam::DVec3;
use std::fs;
use std::num::NonZero;
use std::ops::ControlFlow;
use std::path::Path;
use wm_render::Device;
use wm_street::Street;
use wm_street::dataset::{self, CameraRoute, DatasetOptions};

const PHOTOS: DatasetOptions =
    DatasetOptions { route: CameraRoute::Walk, count: 12, points: 400, ..DatasetOptions::TINY };

fn options() -> SessionOptions {
    let mut options = SessionOptions {
        device: Device::Cpu,
        priors: PriorSource::None,
        held_out: HeldOut { every: 6, from: 0 },
        plan: TrainPlan { steps: Some(6), max_splats: Some(400), ..TrainPlan::default() },
        ..SessionOptions::default()
    };
    options.cpu.threads = Some(1);
    options
}

fn two(region: Option<BlockRegion>) -> BlockOptions {
    BlockOptions { count: BlockCount::Number(NonZero::new(2).unwrap()), region }
}

/// Stops after some steps.
struct Limit(u32);

impl TrainObserver for Limit {
    fn proceed(&mut self) -> ControlFlow<()> {
        if self.0 == 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn on_step(&mut self, _: &StepProgress) {
        self.0 -= 1;
    }
}

#[test]
fn a_block_that_was_stopped_gives_the_same_scene() {
    let folder = tempfile::tempdir().unwrap();
    let set = folder.path().join("set");
    dataset::write(&Street::builtin(), &set, &PHOTOS, &mut |_| true).unwrap();
    let open = |run: &Path| BlockTraining::open(&set, &options(), &two(None), run, &mut ());
    let whole = folder.path().join("whole");
    let mut blocks = open(&whole).unwrap();
    let plan = blocks.plan().clone();
    assert_eq!((plan.blocks.len(), plan.photos), (2, 10));
    assert!(plan.blocks.iter().all(|block| block.cameras.len() >= 3 && block.points > 0));
    let counts: Vec<TrainedBlock> = (0..2).map(|block| blocks.train(block, &mut ()).unwrap()).collect();
    let scene = blocks.join(&mut ()).unwrap();
    assert!(counts.iter().all(|block| block.splats > 0 && block.splats < block.trained), "{counts:?}");
    assert_eq!(scene.splats.len(), counts.iter().map(|block| block.splats).sum::<usize>());
    for (index, mean) in scene.splats.means.iter().enumerate() {
        let block = &plan.blocks[usize::from(index >= counts[0].splats)];
        assert!(plan.is_core(block, DVec3::from_array(mean.map(f64::from))));
    }
    assert_eq!(scene.views.len(), 12);

    // Each step by itself, as on other machines, one of them stopped and killed on the way.
    let run = folder.path().join("run");
    let missing = open(&run).unwrap().join(&mut ()).unwrap_err().to_string();
    assert!(missing.ends_with("blocks 0, 1 are to be trained before they can be joined"), "{missing}");
    assert_eq!(open(&run).unwrap().train(1, &mut ()).unwrap().splats, counts[1].splats);
    let stopped = open(&run).unwrap().train(0, &mut Limit(3)).unwrap_err();
    let BlockError::Session(stopped) = stopped else { panic!("{stopped}") };
    assert!(matches!(*stopped, SessionError::Stopped { step: 3, .. }), "{stopped}");
    fs::write(run.join("block-000/splats.ply.12-0.part"), "ply").unwrap();
    assert_eq!(open(&run).unwrap().trained(0), None);
    open(&run).unwrap().train(0, &mut ()).unwrap();
    let again = open(&run).unwrap().join(&mut ()).unwrap();
    assert_eq!((again.splats, again.metadata), (scene.splats, scene.metadata));
    for file in ["blocks.json", "block-000/splats.ply", "block-000/trained.json", "block-001/splats.ply"] {
        assert!(fs::read(whole.join(file)).unwrap() == fs::read(run.join(file)).unwrap(), "{file}");
    }

    // A block that is trained takes no step; one whose splats were damaged is trained again.
    assert!(open(&run).unwrap().train(0, &mut Limit(0)).is_ok());
    let path = run.join("block-000/splats.ply");
    let sound = fs::read(&path).unwrap();
    let mut damaged = sound.clone();
    *damaged.last_mut().unwrap() ^= 1;
    fs::write(&path, &damaged).unwrap();
    let missing = open(&run).unwrap().join(&mut ()).unwrap_err().to_string();
    assert!(missing.contains(": block 0 is to be trained"), "{missing}");
    open(&run).unwrap().train(0, &mut ()).unwrap();
    assert!(fs::read(&path).unwrap() == sound);
}

#[test]
fn a_region_is_trained_alone_and_other_options_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (set, run) = (folder.path().join("set"), folder.path().join("run"));
    dataset::write(&Street::builtin(), &set, &PHOTOS, &mut |_| true).unwrap();
    let open = |options: &SessionOptions, blocks: &BlockOptions| {
        BlockTraining::open(&set, options, blocks, &run, &mut ())
    };
    let say = |options: &SessionOptions, blocks: &BlockOptions| {
        open(options, blocks).err().map(|error| error.to_string()).unwrap_or_default()
    };
    let far = BlockRegion { low: [1e4; 3], high: [2e4; 3] };
    assert!(say(&options(), &two(Some(far))).starts_with("no point of the reconstruction is in the region"));
    let many = BlockOptions { count: BlockCount::Number(NonZero::new(9).unwrap()), region: None };
    assert!(say(&options(), &many).ends_with("so at most 3 blocks"), "{}", say(&options(), &many));
    let region = BlockRegion { low: [-1e3, -1e3, -1e3], high: [1e3, 1e3, 2.0] };
    let one = BlockOptions { count: BlockCount::Auto, region: Some(region) };
    let mut blocks = open(&options(), &one).unwrap();
    blocks.train(0, &mut ()).unwrap();
    let scene = blocks.join(&mut ()).unwrap();
    assert!(scene.splats.means.iter().all(|mean| region.holds(DVec3::from_array(mean.map(f64::from)))));
    assert!(blocks.train(1, &mut ()).unwrap_err().to_string().contains("no block 1"));

    let mut other = options();
    other.plan.steps = Some(7);
    assert!(say(&other, &one).contains("was planned with other options of the training"));
    other = options();
    other.held_out.every = 5;
    assert!(say(&other, &one).contains("one photo of 6 held out, from 0, not one photo of 5"));
    assert!(say(&options(), &two(Some(region))).contains("was planned with 1 blocks, not 2"));
    assert!(say(&options(), &BlockOptions::default()).contains("was planned with the region ["));
    let path = run.join(PLAN);
    let text = fs::read_to_string(&path).unwrap();
    for (from, to, says) in [
        ("\"version\": 1", "\"version\": 9", "version 9, this program reads 1"),
        ("\"steps\": 6", "\"steps\": 0", "steps"),
        ("\"cameras\": [", "\"cameras\": [], \"x\": [", "unknown field"),
        ("}", "", "is no plan of blocks"),
    ] {
        fs::write(&path, text.replace(from, to)).unwrap();
        let said = say(&options(), &one);
        assert!(said.contains(says) && said.ends_with("plan again with --overwrite"), "{said}");
    }
}
