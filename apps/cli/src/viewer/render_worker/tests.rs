//! A task that fails leaves the worker as it was, and whoever waits is told.

use super::assets::PendingAssets;
use super::*;
use crate::scene::RunArgs;
use crate::viewer::client_queue::ClientQueue;
use crate::viewer::context::{Loaded, ViewerContext};
use crate::viewer::facts::FactEditor;
use std::sync::mpsc::channel;
use tokio::sync::oneshot;
use weather_magician::{Camera, PlaceOptions};
use wm_scene::{Metadata, Scene, synthetic};
use wm_viewer::testing::{catalog, state};

fn worker() -> RenderWorker {
    let run = RunArgs { device: "cpu".parse().unwrap(), ..RunArgs::default() };
    let mut renderer = run.renderer().unwrap();
    let metadata = Metadata { up: Some(DVec3::Z), metres_per_unit: Some(1.0), ..Metadata::default() };
    let scene = Scene { splats: synthetic::table(1).build(), metadata, ..Scene::default() };
    let place = renderer.load_with(scene, &PlaceOptions::default()).unwrap();
    let facts = FactEditor::new(
        "no/such/folder/table.ply".into(),
        wm_scene::survey::OwnSky::Keep,
        &place,
        Vec::new(),
    );
    let context = Arc::<ViewerContext>::default();
    let catalog = wm_viewer::Catalog { survey: place.survey().clone(), ..catalog() };
    context.set_loaded(Loaded { catalog: Arc::new(catalog), start: state() });
    RenderWorker::new(context, renderer, place, facts)
}

/// Returns a view from above, in which rain falls.
fn view_of(worker: &RenderWorker) -> Arc<View> {
    let weather = json!({ "rain": { "rate": 10 }, "wetness": {} });
    let eye = DVec3::new(0.0, -6.0, 3.0);
    let camera = Camera::looking((32, 24), 50.0, eye, DVec3::ZERO, DVec3::Z).unwrap();
    let state = wm_viewer::ViewState {
        weather,
        camera: wm_viewer::state::Pose::of(&camera),
        size: [32, 24],
        ..state()
    };
    Arc::new(View::new(state, &worker.context.catalog(), None).unwrap())
}

fn drawn(worker: &mut RenderWorker, view: &View) -> Vec<u8> {
    let options = PaintOptions { size: view.size(), patience: Patience::Whole, dither: Dither::Ordered };
    worker.draw(view, options).unwrap().0
}

#[test]
fn after_a_panic_the_next_task_is_done_as_before() {
    let mut worker = worker();
    let view = view_of(&worker);
    let before = drawn(&mut worker, &view);
    assert!(before.iter().any(|byte| *byte != before[0]));
    let outcome: Result<(), String> = worker.attempt(|worker| {
        // Half of a change.
        let mut facts = worker.place.facts();
        facts.scene.up = Some(DVec3::X);
        worker.renderer.set_facts(&mut worker.place, facts)?;
        panic!("a fault of {}", "the program");
    });
    let error = outcome.unwrap_err();
    assert_eq!(error, "the program failed at this: a fault of the program");
    assert!(worker.broken.is_none());
    assert!(drawn(&mut worker, &view) == before, "the place is not as it was");
}

#[test]
fn who_waits_for_what_cannot_be_made_is_told() {
    let mut worker = worker();
    let view = view_of(&worker);
    let client_queue = Arc::<ClientQueue>::default();
    let client = worker.context.queue.add_client(Arc::clone(&client_queue)).unwrap();
    let request = ViewRequest { view: Arc::clone(&view), seq: 3, is_moving: false };
    worker.context.queue.set_request(client, request);
    let (reply, mut answer) = oneshot::channel();
    let picture =
        |reply| ViewerCommand::Picture { view: Arc::clone(&view), format: ResponseFormat::Jpeg, reply };
    worker.wait(picture(reply));
    for owner in [AssetOwner::Client(client), AssetOwner::Waiting(0), AssetOwner::Video] {
        // The thread that made them is gone.
        let (_, receive) = channel();
        worker.pending = Some(PendingAssets { receive, owner, is_stopped: Arc::default() });
        worker.collect_assets();
        assert!(worker.pending.is_none(), "{owner:?}");
    }
    let why = "the program failed while it prepared the scene for this weather";
    let (texts, _) = client_queue.take_all();
    assert_eq!(texts.iter().filter(|text| text.contains(why)).count(), 1, "{texts:?}");
    assert!(worker.context.queue.next_task(Duration::ZERO).is_none(), "it is served again and again");
    assert_eq!(answer.try_recv().unwrap().err().as_deref(), Some(why));
    // Nobody waits for what was abandoned.
    let (reply, answer) = oneshot::channel();
    drop(answer);
    worker.execute(picture(reply));
    assert!(worker.pending.is_none() && worker.waiting.is_empty());
}
