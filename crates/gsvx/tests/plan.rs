//! A scene encoded tile by tile, and joined, is the scene encoded in memory.
#![cfg(feature = "encode")]

use gs_model::Scene;
use gsvx::{
    Choices, CodeOptions, EncodeOptions, Error, ImportanceFrom, Index, Plan, Survey, encode, join,
};
use std::num::NonZeroUsize;

/// A dense part, a wide one, and one far away, mixed in the order of the scene.
fn city(len: usize) -> Scene {
    let mut rng = testing::Rng::seeded(11);
    let mut scene = testing::trained_like(len, 1, &mut rng);
    for i in 0..len {
        let scale = [1.0, 12.0, 3.0][i % 3];
        scene.means[i] = scene.means[i].map(|x| scale * x);
        scene.means[i][0] += [0.0, 5.0, 400.0][i % 3];
        scene.log_scales[i] = scene.log_scales[i].map(|l| l + libm::logf(scale));
    }
    scene.antialiased = true;
    scene.origin = [448_200.25, 5_411_900.5, 46.0];
    scene
}

fn choices(quality: f32) -> Choices {
    let chunk_leaves = NonZeroUsize::new(20_000).unwrap();
    let code = CodeOptions { chunk_leaves, ..CodeOptions::default() };
    Choices { quality, importance: ImportanceFrom::Guess, code }
}

/// A plan, from a scene that arrives in pieces, and the Gaussians of each tile.
fn planned(scene: &Scene, choices: Choices) -> (Plan, Vec<Scene>) {
    let piece = |first: usize| {
        let last = scene.len().min(first + 70_001);
        scene.select(&(first..last).collect::<Vec<_>>())
    };
    let pieces: Vec<Scene> = (0..scene.len()).step_by(70_001).map(piece).collect();
    let mut survey = Survey::new(choices.code.max_sh_degree);
    pieces.iter().rev().for_each(|p| survey.add(p));
    let mut plan = Plan::new::<Error>(&survey, choices, |take| {
        pieces.iter().rev().for_each(|p| take(&p.means));
        Ok(())
    })
    .unwrap();
    let mut members = vec![Vec::new(); plan.tile_counts().len()];
    let tiles = plan.tiles_of(&scene.means).unwrap();
    tiles.iter().enumerate().for_each(|(i, &t)| members[t as usize].push(i));
    let scenes: Vec<Scene> = members.iter().map(|m| scene.select(m)).collect();
    let seen = |_: &Scene| -> Result<_, Error> { unreachable!("importances are guessed") };
    plan.measure(|tile| Ok(scenes[tile].clone()), seen).unwrap();
    (plan, scenes)
}

/// The stream that some streams are joined to.
fn joined(streams: &[Vec<u8>]) -> Vec<u8> {
    let indices: Vec<Index> = streams.iter().map(|s| Index::parse(s).unwrap()).collect();
    let joined = join(&indices).unwrap();
    let mut bytes = joined.head.clone();
    for (number, range) in &joined.pieces {
        bytes.extend(&streams[*number][range.start as usize..range.end as usize]);
    }
    assert_eq!(Index::parse(&bytes).unwrap(), joined.index);
    bytes
}

#[test]
fn tiles_joined_are_the_scene_in_memory() {
    for lod in [false, true] {
        let mut choices = choices(60.0);
        choices.code.lod = lod;
        tiles_joined_are_the_scene(choices);
    }
}

fn tiles_joined_are_the_scene(choices: Choices) {
    let scene = city(600_000);
    let (plan, tiles) = planned(&scene, choices);
    assert!(tiles.len() >= 3, "{} tiles", tiles.len());
    let streams: Vec<Vec<u8>> =
        tiles.iter().enumerate().map(|(t, s)| plan.encode(t, s, &[]).unwrap().bytes).collect();
    let options = EncodeOptions { code: choices.code, ..EncodeOptions::default() };
    let whole = encode(&scene, None, 60.0, &options).unwrap();
    assert!(joined(&streams) == whole.bytes);
    assert_eq!(gsvx::decode(&whole.bytes).unwrap().len() as u64, whole.index.header.count);
    // Each level has about a ninth of the Gaussians of the next finer, in chunks that nest.
    let index = &whole.index;
    assert_eq!(index.coarsest_lod(), if choices.code.lod { 2 } else { 0 });
    let leaves = |lod| index.chunks_of_lod(lod).map(|c| index.chunks[c].count).sum::<u64>();
    for lod in 0..index.coarsest_lod() {
        let (fine, coarse) = (leaves(lod), leaves(lod + 1));
        assert!(coarse <= fine / 8 && coarse >= fine / 40, "{fine} leaves above {coarse}");
        let finer = index.chunks_of_lod(lod + 1).flat_map(|c| index.finer(c)).collect::<Vec<_>>();
        assert_eq!(finer, index.chunks_of_lod(lod).collect::<Vec<_>>());
    }
    // In any order, in two steps, and with a part without tiles.
    let mut parts: Vec<Vec<u8>> = streams.chunks(2).map(joined).collect();
    parts.push(plan.encode_nothing().unwrap().bytes);
    parts.reverse();
    assert!(joined(&parts) == whole.bytes);
    // The plan survives its text.
    let text = serde_json::to_string(&plan).unwrap();
    assert_eq!(serde_json::from_str::<Plan>(&text).unwrap(), plan);
}

#[test]
fn a_scene_of_one_tile_is_planned_too() {
    for len in [0, 1, 700] {
        let scene = city(len);
        let (plan, tiles) = planned(&scene, choices(40.0));
        let stream = plan.encode(0, &tiles[0], &[]).unwrap().bytes;
        let options = EncodeOptions { code: choices(40.0).code, ..EncodeOptions::default() };
        let whole = encode(&scene, None, 40.0, &options).unwrap().bytes;
        assert!(stream == whole, "{len}");
        assert!(joined(&[stream]) == whole, "{len}");
    }
}

#[test]
fn what_does_not_belong_together_is_not_joined() {
    let index = |scene: &Scene, quality: f32, lod: bool| {
        let mut options = EncodeOptions::default();
        options.code.lod = lod;
        encode(scene, None, quality, &options).unwrap().index
    };
    let scene = city(600);
    let one = index(&scene, 50.0, false);
    for other in [index(&scene, 51.0, false), index(&city(601), 50.0, false), one.clone()] {
        let error = join(&[one.clone(), other]).unwrap_err();
        assert!(matches!(error, Error::NotOneScene { first: 0, second: 1, .. }), "{error}");
    }
    let of_another_kind = Scene { antialiased: false, ..scene.clone() };
    let elsewhere = Scene { origin: [1.0; 3], ..scene.clone() };
    for other in [of_another_kind, elsewhere] {
        assert!(join(&[one.clone(), index(&other, 50.0, false)]).is_err());
    }
    // Levels of detail in one part only.
    let mut other = one.clone();
    other.chunks.iter_mut().for_each(|c| c.first_cell += 1);
    assert!(join(&[one.clone(), other.clone()]).is_ok());
    assert!(join(&[index(&scene, 50.0, true), other]).is_err());
    let (plan, tiles) = planned(&scene, choices(50.0));
    assert!(matches!(plan.encode(0, &tiles[0].select(&[1, 2]), &[]), Err(Error::Length { .. })));
    assert!(plan.tiles_of(&[[1e9; 3]]).is_err());
}
