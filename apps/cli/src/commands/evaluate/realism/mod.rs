//! `evaluate --pictures` and `--paper`: similarity of pictures to photographs of real weather
//! (CMMD), and the tables of the paper.

mod args;
mod cache;
mod collect;
mod layout;
mod network;
mod published;
mod tables;
mod uvq;

pub(crate) use args::RealismArgs;

use super::args::EvaluateArgs;
use crate::output::{json_text, write_text};
use crate::progress;
use crate::scene::threads;
use anyhow::{Result, bail};
use collect::{CollectedSet, Collector};
use indicatif::{ProgressBar, ProgressFinish};
use layout::{PictureSet, WeatherClass};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use tables::{CmmdDistance, Tables};
use weather_magician::train::metrics::{Collection, Embeddings};
use wm_base::files::check_writable;

/// Runs the command.
pub(crate) fn run(whole: &EvaluateArgs) -> Result<()> {
    let (args, json) = (&whole.realism, whole.json.as_deref());
    for out in [json, args.csv.as_deref(), args.markdown.as_deref()].into_iter().flatten() {
        check_writable(out)?;
        whole.overwrite.check_report(out, &[])?;
    }
    let tables = threads(whole.run.threads)?.install(|| match &args.paper {
        Some(methods) => of_paper(whole, methods),
        None => of_pictures(whole),
    })?;
    let markdown = tables.markdown();
    print!("{markdown}");
    let write = |path: Option<&Path>, text: &str| path.map_or(Ok(()), |path| write_text(path, text));
    write(args.markdown.as_deref(), &markdown)?;
    write(args.csv.as_deref(), &tables.csv())?;
    write(json, &json_text(&tables.json())?)
}

/// Compares each collection with the real one.
fn of_pictures(whole: &EvaluateArgs) -> Result<Tables> {
    let args = &whole.realism;
    let real = args.real.as_deref().expect("--pictures requires it");
    let mut parts = Vec::new();
    for path in args.pictures.iter().map(PathBuf::as_path).chain([real]) {
        parts.push(PictureSet::whole(path)?);
    }
    let mut collector = Collector::new(whole);
    for (index, part) in parts.iter().enumerate() {
        if let Some(other) = parts[..index].iter().find(|other| other.name == part.name) {
            collector.forbid_one_name(&other.path, &part.path)?;
        }
        collector.add(part.clone(), part.place.clone())?;
    }
    let mut collected = collector.run()?;
    let _busy = comparison_spinner();
    let real = Collection::new(collected.pop().expect("the last one").embeddings);
    let distance = |CollectedSet { name, embeddings }: CollectedSet| {
        CmmdDistance::new(name, None, None, &Collection::new(embeddings), &real)
    };
    Ok(Tables { distances: collected.into_iter().map(distance).collect(), ..Tables::default() })
}

/// Makes the tables of the paper.
fn of_paper(whole: &EvaluateArgs, methods: &[PathBuf]) -> Result<Tables> {
    let args = &whole.realism;
    let scores = args.uvq.iter().map(|file| uvq::read(file)).collect::<Result<Vec<_>>>()?.concat();
    let Some(real) = &args.real else {
        if !methods.is_empty() || scores.is_empty() {
            bail!(
                "--paper: there is nothing to compare with; give --real FOLDER with photographs of fog, rain and snow, or \
                 --paper --uvq FILE for that table alone"
            );
        }
        return Ok(Tables { scores, paper: true, ..Tables::default() });
    };
    let names = names_of(methods)?;
    let mut collector = Collector::new(whole);
    let mut places = Vec::new();
    let methods = methods.iter().enumerate().map(|(index, folder)| (Some(index), folder));
    for (method, folder) in methods.chain([(None, real)]) {
        let name = method.map_or(REAL, |index| &names[index]);
        for (weather, part) in layout::parts(folder)? {
            places.push((method, weather, part.scene.clone()));
            let place = Path::new(name).join(&part.place);
            collector.add(part, place)?;
        }
    }
    let has_photographs =
        |weather: WeatherClass| places.iter().any(|(method, of, _)| method.is_none() && *of == weather);
    for (method, weather, _) in &places {
        if let Some(method) = method.filter(|_| !has_photographs(*weather)) {
            bail!(
                "{}: there are no photographs of {} to compare {}'s pictures with; put them there",
                real.display(),
                weather.name(),
                names[method]
            );
        }
    }
    let mut parts: BTreeMap<(Option<usize>, WeatherClass), Vec<_>> = BTreeMap::new();
    for ((method, weather, scene), collected) in places.into_iter().zip(collector.run()?) {
        parts.entry((method, weather)).or_default().push((scene, collected.embeddings));
    }
    let _busy = comparison_spinner();
    let (mut reals, mut distances) = (BTreeMap::new(), Vec::new());
    // The photographs come first.
    for ((method, weather), parts) in parts {
        let all = joined(parts.iter().map(|(_, part)| part));
        let Some(method) = method else {
            reals.insert(weather, all);
            continue;
        };
        // Snow that falls and snow that lies may have the same scene.
        let scenes: BTreeSet<&String> = parts.iter().filter_map(|(scene, _)| scene.as_ref()).collect();
        let of_scene = |name| parts.iter().filter(move |(scene, _)| scene.as_ref() == Some(name));
        let scenes =
            scenes.into_iter().map(|name| (Some(name.clone()), joined(of_scene(name).map(|(_, part)| part))));
        for (scene, collection) in [(None, all)].into_iter().chain(scenes) {
            let (real, method, weather) = (&reals[&weather], names[method].clone(), Some(weather));
            distances.push(CmmdDistance::new(method, weather, scene, &collection, real));
        }
    }
    Ok(Tables { distances, scores, paper: true })
}

/// Joins one or more sets of embeddings.
fn joined<'a>(mut parts: impl Iterator<Item = &'a Embeddings>) -> Collection {
    let mut all = parts.next().expect("no group without a part").clone();
    parts.for_each(|more| all.extend(more));
    Collection::new(all)
}

/// Returns a spinner, shown until it is dropped, while all pairs of pictures are compared; this
/// takes a while for thousands of them.
fn comparison_spinner() -> ProgressBar {
    progress::spinner("comparing collections").with_finish(ProgressFinish::AndClear)
}

/// The name under which embeddings of photographs are kept.
const REAL: &str = "real";

/// Returns the names of methods, those of their folders.
fn names_of(methods: &[PathBuf]) -> Result<Vec<String>> {
    if methods.is_empty() {
        bail!("--paper: no folder of a method is named; give at least one");
    }
    let mut names: Vec<String> = Vec::new();
    for folder in methods {
        let name = layout::name_of(folder);
        if name == REAL || names.contains(&name) {
            bail!(
                "--paper {}: the name {name} is taken, and methods are called as their folders; rename it",
                folder.display()
            );
        }
        names.push(name);
    }
    Ok(names)
}
