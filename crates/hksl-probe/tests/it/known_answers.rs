//! Analyses of encoders and communication managers with known results.

use candle_core::{DType, Device};
use hksl_core::nn::{Initialisation, PixelEncoderConfig};
use hksl_core::rng;
use hksl_envs::Settings;
use hksl_probe::attention::attention;
use hksl_probe::communication::{channels, starts, step_distances};
use hksl_probe::coordinates::Coordinates;
use hksl_probe::episodes::{Episode, Policy, collect, latents};
use hksl_probe::linear_probe::{Descent, Example, Fit, probe};
use hksl_sac::config::{
    AugmentationConfig, HkslConfig, ReplayConfig, ReplayStorage, SacConfig, ShiftPer,
    UpdateSchedule,
};
use hksl_sac::hksl::{Architecture, Hksl};
use hksl_sac::replay::Layout;
use hksl_sac::{Agent, Learner, ReceptiveField};
use ndarray::{Array2, Axis, concatenate, s};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const TRAIN: usize = 10;
const HORIZON: usize = 3;
const STACK: usize = 3;

/// Random episodes of Falling Pixels, and where the agent is in each.
fn episodes() -> (Vec<Episode>, Vec<Array2<f64>>) {
    let settings = Settings::new(35, 15, 120);
    let mut environment =
        hksl_envs::make("falling-pixels", &settings, ChaCha8Rng::seed_from_u64(1)).unwrap();
    let coordinates = Coordinates::of_task(environment.spec()).unwrap();
    let mut policy = Policy::Random(Box::new(ChaCha8Rng::seed_from_u64(2)));
    let episodes = collect(environment.as_mut(), &mut policy, 15, &mut |_| {}).unwrap();
    let columns = episodes.iter().map(|episode| coordinates.values(episode)).collect();
    (episodes, columns)
}

/// Mean error of a probe on these latents, and mean error of the constant baseline.
fn errors(latents: &[Array2<f64>], columns: &[Array2<f64>], fit: &Fit) -> (f64, f64) {
    let examples: Vec<Example> = latents
        .iter()
        .zip(columns)
        .map(|(latents, columns)| Example { latents: latents.view(), coordinates: columns.view() })
        .collect();
    let errors = probe(&examples[..TRAIN], &examples[TRAIN..], HORIZON, fit).unwrap();
    assert_eq!((errors.by_episode.len(), errors.by_coordinate.len()), (5, 1));
    assert!((errors.by_coordinate[0] - errors.mean()).abs() < 1e-9 * errors.constant_mean());
    (errors.mean(), errors.constant_mean())
}

/// 50 numbers a time that hold the coordinate of `HORIZON` steps later among noise, mixed.
fn knowing(columns: &Array2<f64>, mixing: &Array2<f64>, random: &mut ChaCha8Rng) -> Array2<f64> {
    let rows = columns.nrows();
    let mut hidden = noise((rows, 50), random);
    for time in 0..rows - HORIZON {
        hidden[(time, 7)] = columns[(time + HORIZON, 0)];
    }
    hidden.dot(mixing)
}

fn noise(shape: (usize, usize), random: &mut ChaCha8Rng) -> Array2<f64> {
    Array2::from_shape_fn(shape, |_| random.random_range(-1.0..1.0))
}

#[test]
fn an_exactly_linear_target_is_recovered() {
    let (_, columns) = episodes();
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mixing = noise((50, 50), &mut random);
    let latents: Vec<_> = columns.iter().map(|of| knowing(of, &mixing, &mut random)).collect();
    let (error, constant) = errors(&latents, &columns, &Fit::default());
    assert!(error < 1e-6 * constant, "{error} of {constant}");
    // As well where all latents lie close together, as collapsed ones do.
    let close: Vec<_> = latents.iter().map(|of| of.mapv(|value| 1.0 + 1e-4 * value)).collect();
    let (error, _) = errors(&close, &columns, &Fit::default());
    assert!(error < 1e-6 * constant, "{error} of {constant}");
}

#[test]
fn latents_that_are_no_numbers_are_told() {
    let (_, columns) = episodes();
    let mut latents: Vec<_> = columns.iter().map(|of| Array2::ones((of.nrows(), 2))).collect();
    latents[3][(5, 1)] = f64::NAN;
    let example = |index: usize| Example {
        latents: latents[index].view(),
        coordinates: columns[index].view(),
    };
    let error = probe(&[example(3)], &[example(4)], 1, &Fit::default()).unwrap_err();
    assert!(error.to_string().contains("not finite"), "{error}");
    let error = probe(&[example(4)], &[example(3)], 1, &Fit::default()).unwrap_err();
    assert!(error.to_string().contains("not finite"), "{error}");
    let error = hksl_probe::pca::pca(latents[3].view(), 2).unwrap_err();
    assert!(error.to_string().contains("not finite"), "{error}");
}

#[test]
fn test_episodes_that_do_not_fit_are_told() {
    let (_, columns) = episodes();
    let [two, three] = [2, 3].map(|width| Array2::ones((columns[0].nrows(), width)));
    let [two, three] = [&two, &three]
        .map(|latents| Example { latents: latents.view(), coordinates: columns[0].view() });
    let said =
        |test: &[Example<'_>]| probe(&[two], test, 1, &Fit::default()).unwrap_err().to_string();
    assert!(said(&[three]).contains("3 latents and 1 coordinates, expected one or more"));
    assert!(said(&[]).contains("test episodes: none"));
}

#[test]
fn gradient_descent_comes_to_the_same_map() {
    let (_, columns) = episodes();
    let mut random = ChaCha8Rng::seed_from_u64(6);
    // The coordinate now, a constant, and noise: what is best to say is not all that there is.
    let latents: Vec<Array2<f64>> = columns
        .iter()
        .map(|of| {
            let rows = of.nrows();
            let parts = [of / 7.0 - 1.0, Array2::ones((rows, 1)), noise((rows, 3), &mut random)];
            let views: Vec<_> = parts.iter().map(|part| part.view()).collect();
            concatenate(Axis(1), &views).unwrap()
        })
        .collect();
    let (closed, constant) = errors(&latents, &columns, &Fit::default());
    let learnt = Fit::GradientDescent(Descent { epochs: 400, ..Descent::default() });
    let (learnt, _) = errors(&latents, &columns, &learnt);
    assert!(closed < 0.7 * constant, "{closed} of {constant}");
    assert!((learnt / closed - 1.0).abs() < 0.02, "{learnt} and {closed}");
}

#[test]
fn an_encoder_that_says_nothing_is_as_good_as_the_mean() {
    let (_, columns) = episodes();
    let training: Vec<f64> =
        columns[..TRAIN].iter().flat_map(|of| of.slice(s![HORIZON.., 0]).to_vec()).collect();
    let mean = training.iter().sum::<f64>() / training.len() as f64;
    let deviation = columns[TRAIN..]
        .iter()
        .map(|of| of.slice(s![HORIZON.., 0]).mapv(|value| (value - mean).powi(2)).mean().unwrap());
    let expected = deviation.sum::<f64>() / 5.0;
    for value in [0.0, 0.1, -3e4] {
        let latents: Vec<_> =
            columns.iter().map(|of| Array2::from_elem((of.nrows(), 50), value)).collect();
        let (error, constant) = errors(&latents, &columns, &Fit::default());
        assert!((error - expected).abs() < 1e-6, "{error}, expected {expected}");
        assert!((constant - expected).abs() < 1e-9, "{constant}, expected {expected}");
    }
    // Nor if it differs by the rounding of f32 from one batch to the next.
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let jitter = columns.iter().map(|of| {
        let rounding = noise((of.nrows(), 50), &mut random);
        rounding.mapv(|value| 0.7 * (1.0 + value * f64::from(f32::EPSILON)))
    });
    let (error, _) = errors(&jitter.collect::<Vec<_>>(), &columns, &Fit::default());
    assert!((error - expected).abs() < 1e-6, "{error}, expected {expected}");
    let latents: Vec<_> = columns.iter().map(|of| noise((of.nrows(), 50), &mut random)).collect();
    let (error, constant) = errors(&latents, &columns, &Fit::default());
    assert!(error > 0.95 * constant, "{error} of {constant}");
}

fn hksl(skips: &[usize], communication: bool) -> Hksl {
    let architecture = Architecture {
        observation: [STACK, 35, 15],
        action_dims: 1,
        encoder: PixelEncoderConfig { filters: 4, latent_dims: 6 },
        hksl: HkslConfig {
            skips: skips.to_vec(),
            trajectory_length: 6,
            learning_rate: 1e-3,
            actor_update_every: 1,
            update_schedule: UpdateSchedule::Sequential,
            initialisation: Initialisation::Uniform,
            communication_hidden: 10,
            representation: true,
            communication,
            projection: true,
            shared_encoder: false,
        },
        sac: SacConfig {
            batch_size: 2,
            discount: 0.99,
            learning_rate: 1e-3,
            initial_temperature: 0.1,
            hidden_units: 8,
            log_std_minimum: -10.0,
            log_std_maximum: 2.0,
            target_update_every: 2,
            critic_tau: 0.01,
            encoder_tau: 0.05,
        },
    };
    Hksl::new(architecture, 1, &Device::Cpu).unwrap()
}

fn agent(skips: &[usize], communication: bool) -> Agent {
    let learner = Box::new(hksl(skips, communication));
    let layout = Layout { frame: [1, 35, 15], stack: STACK, action_dims: 1 };
    let (replay, augmentation) = (
        ReplayConfig { capacity: 10, storage: ReplayStorage::Memory },
        AugmentationConfig { pad: 4, shift_per: ShiftPer::Observation },
    );
    Agent::new(learner, layout, &replay, &augmentation, 1, &Device::Cpu).unwrap()
}

#[test]
fn a_manager_that_ignores_its_step_says_the_same_at_each() {
    let (episodes, _) = episodes();
    let learner = hksl(&[1, 3, 5], true);
    let mut random = rng::stream(1, "test");
    let starts = starts(&episodes, 6, 7, &mut random).unwrap();
    let before = channels(learner.hierarchy(), &episodes, &starts, STACK, &Device::Cpu).unwrap();
    assert_eq!(before.len(), 2);
    assert_eq!(before[0].outputs.dim(), (7, 6, 6));
    assert_eq!(before[1].outputs.dim(), (7, 2, 6));
    assert_eq!((before[1].from_level, before[1].to_level), (3, 2));
    assert!(step_distances(before[0].outputs.view())[(0, 5)] > 1e-3);

    // The one-hot of the step is what the first layer reads last.
    let mut weights = learner.networks().weights().unwrap();
    let name = "levels.0.communication.0.weight";
    let first = weights.get(name).unwrap_or_else(|| panic!("{:?}", weights.keys()));
    let (rows, columns) = first.dims2().unwrap();
    assert_eq!(columns, 2 * 6 + 6);
    let mask: Vec<f32> =
        (0..rows * columns).map(|i| if i % columns < 12 { 1.0 } else { 0.0 }).collect();
    let mask = candle_core::Tensor::from_vec(mask, (rows, columns), &Device::Cpu).unwrap();
    let deaf = (first * mask).unwrap();
    weights.insert(name.to_owned(), deaf);
    learner.networks().load_weights(&weights).unwrap();
    let after = channels(learner.hierarchy(), &episodes, &starts, STACK, &Device::Cpu).unwrap();
    assert!(step_distances(after[0].outputs.view()).iter().all(|&distance| distance == 0.0));
    // Its outputs still differ between trajectories.
    let outputs = &after[0].outputs;
    assert!(outputs.slice(s![0, 0, ..]) != outputs.slice(s![1, 0, ..]));
    assert_eq!(after[1], before[1]);
}

#[test]
fn an_agent_without_channels_is_told_so() {
    let (episodes, _) = episodes();
    let starts = starts(&episodes, 6, 3, &mut rng::stream(1, "test")).unwrap();
    for (learner, word) in [(hksl(&[1], true), "single level"), (hksl(&[1, 3], false), "no-c")] {
        let error =
            channels(learner.hierarchy(), &episodes, &starts, STACK, &Device::Cpu).unwrap_err();
        assert!(error.to_string().contains(word), "{error}");
    }
}

#[test]
fn latents_and_attention_are_the_encoders_own() {
    let (episodes, _) = episodes();
    let agent = agent(&[1, 3], true);
    let episode = &episodes[0];
    let found = latents(&agent, episode, STACK, &Device::Cpu).unwrap();
    let maps = attention(&agent, episode, STACK, &Device::Cpu).unwrap();
    assert_eq!((found.len(), found[1].values.dim()), (2, (121, 6)));
    assert_eq!(
        (maps.len(), maps[0].maps.dim(), maps[0].field),
        (2, (121, 11, 1), ReceptiveField { side: 15, spacing: 2 })
    );
    // Encoded alone, an observation deep in the episode gives the same.
    let alone = episode.observations(&[100], STACK, &Device::Cpu).unwrap();
    let (name, latent) = &agent.networks().encode(&alone).unwrap()[1];
    let latent = latent.to_dtype(DType::F64).unwrap().to_vec2::<f64>().unwrap();
    assert_eq!(name, &found[1].encoder);
    for (a, b) in found[1].values.row(100).iter().zip(&latent[0]) {
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
    let of = &agent.networks().feature_maps(&alone).unwrap()[0];
    let mean = of.maps.mean_keepdim(1).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
    for (a, b) in maps[0].maps.index_axis(Axis(0), 100).iter().zip(&mean) {
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
    let (low, high) = maps[0].range();
    assert!(low >= 0.0 && high > low);
}
