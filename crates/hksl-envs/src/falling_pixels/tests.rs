//! Each rule of the game by itself, then what random play is worth.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::*;

const SETTINGS: Settings = Settings::new(35, 15, 250);

fn environment(seed: u64) -> FallingPixels {
    let mut environment = FallingPixels::new(&SETTINGS, ChaCha8Rng::seed_from_u64(seed)).unwrap();
    environment.reset().unwrap();
    environment
}

/// A grid with the agent in a column and pixels of (column, row, speed), and nothing else.
fn grid(agent_column: usize, pixels: &[(usize, usize, usize)]) -> FallingPixels {
    let mut environment = environment(1);
    environment.state.agent_column = agent_column;
    environment.state.pixels.fill(None);
    for &(column, row, speed) in pixels {
        environment.state.pixels[column] = Some(Pixel { row, speed });
    }
    environment
}

fn column_after(agent_column: usize, action: f32) -> usize {
    let mut environment = grid(agent_column, &[]);
    environment.step(&[action]).unwrap();
    environment.state.agent_column
}

#[test]
fn reset_puts_a_pixel_in_every_column_of_the_top_row() {
    let environment = environment(0);
    for pixel in environment.state.pixels.iter().map(|place| place.unwrap()) {
        assert_eq!(pixel.row, 0);
        assert!(SPEEDS.contains(&pixel.speed));
    }
}

#[test]
fn start_columns_and_speeds_are_uniform() {
    let mut environment = environment(0);
    let (mut columns, mut speeds) = ([0usize; 15], [0usize; 3]);
    let resets = 3000;
    for _ in 0..resets {
        environment.reset().unwrap();
        columns[environment.state.agent_column] += 1;
        for pixel in environment.state.pixels.iter().flatten() {
            speeds[SPEEDS.iter().position(|&speed| speed == pixel.speed).unwrap()] += 1;
        }
    }
    // Expected 200 a column (deviation 14) and 15000 a speed (deviation 100).
    assert!(columns.iter().all(|count| (140..260).contains(count)), "{columns:?}");
    assert!(speeds.iter().all(|count| (14_500..15_500).contains(count)), "{speeds:?}");
}

#[test]
fn the_agent_moves_beyond_a_third_only() {
    let third = 1.0f32 / 3.0;
    for (action, expected) in [
        (-1.0, 6),
        (-third.next_up(), 6),
        (-third, 7),
        (0.0, 7),
        (third, 7),
        (third.next_up(), 8),
        (1.0, 8),
        (40.0, 8),
    ] {
        assert_eq!(column_after(7, action), expected, "action {action}");
    }
}

#[test]
fn walls_stop_the_agent() {
    assert_eq!(column_after(0, -1.0), 0);
    assert_eq!(column_after(14, 1.0), 14);
    assert_eq!(column_after(0, 1.0), 1);
    assert_eq!(column_after(14, -1.0), 13);
}

#[test]
fn every_pixel_falls_by_its_speed() {
    let mut environment = grid(0, &[(2, 4, 1), (3, 4, 3), (4, 4, 5)]);
    environment.step(&[0.0]).unwrap();
    let row = |column: usize| environment.state.pixels[column].unwrap();
    assert_eq!((row(2).row, row(3).row, row(4).row), (5, 7, 9));
    assert_eq!((row(2).speed, row(3).speed, row(4).speed), (1, 3, 5));
}

#[test]
fn a_pixel_lands_on_the_bottom_row_and_not_below() {
    // From row 32 the fastest would reach row 37 of 0..=34: it lands, and is caught, all the same.
    for (row, speed, lands) in [(32, 5, true), (31, 3, true), (30, 3, false), (33, 1, true)] {
        let mut environment = grid(6, &[(6, row, speed)]);
        let reward = environment.step(&[0.0]).unwrap().reward;
        assert_eq!(reward, if lands { 1.0 } else { 0.0 }, "row {row}, speed {speed}");
        assert_eq!(environment.state.pixels[6].is_none(), lands, "row {row}, speed {speed}");
    }
}

#[test]
fn only_a_pixel_in_the_agents_column_pays_and_both_disappear() {
    let mut environment = grid(6, &[(5, 33, 1), (6, 33, 1), (7, 33, 1)]);
    let step = environment.step(&[0.0]).unwrap();
    assert_eq!(step.reward, 1.0);
    assert_eq!(environment.state.pixels[5..8], [None, None, None]);
}

#[test]
fn the_agent_moves_before_pixels_land() {
    let mut left = grid(6, &[(5, 33, 1)]);
    assert_eq!(left.step(&[-1.0]).unwrap().reward, 1.0);
    let mut stayed = grid(6, &[(5, 33, 1)]);
    assert_eq!(stayed.step(&[0.0]).unwrap().reward, 0.0);
    let mut moved_away = grid(6, &[(6, 33, 1)]);
    assert_eq!(moved_away.step(&[1.0]).unwrap().reward, 0.0);
}

#[test]
fn empty_columns_get_a_pixel_with_the_stated_chance_at_the_top() {
    let mut environment = environment(5);
    let (mut spawned, mut speeds, trials) = (0usize, [0usize; 3], 4000);
    for _ in 0..trials {
        environment.state.pixels.fill(None);
        environment.state.steps = Some(0);
        environment.step(&[0.0]).unwrap();
        for pixel in environment.state.pixels.iter().flatten() {
            assert_eq!(pixel.row, 0, "a new pixel does not fall in the step that made it");
            spawned += 1;
            speeds[SPEEDS.iter().position(|&speed| speed == pixel.speed).unwrap()] += 1;
        }
    }
    // 60,000 columns at 0.025: 1500, deviation 38; a third of them each speed, deviation 18.
    assert!((1350..1650).contains(&spawned), "{spawned}");
    assert!(speeds.iter().all(|count| (400..600).contains(count)), "{speeds:?}");
}

#[test]
fn a_column_emptied_in_this_step_waits_for_the_next() {
    let mut environment = environment(6);
    for _ in 0..2000 {
        environment.state.steps = Some(0);
        environment.state.pixels.fill(Some(Pixel { row: 33, speed: 1 }));
        environment.step(&[0.0]).unwrap();
        assert!(environment.state.pixels.iter().all(Option::is_none));
    }
}

#[test]
fn an_occupied_column_gets_no_second_pixel() {
    let mut environment = environment(7);
    for _ in 0..2000 {
        environment.state.steps = Some(0);
        environment.state.pixels.fill(Some(Pixel { row: 9, speed: 3 }));
        environment.step(&[0.0]).unwrap();
        let expected = Some(Pixel { row: 12, speed: 3 });
        assert!(environment.state.pixels.iter().all(|pixel| *pixel == expected));
    }
}

#[test]
fn the_time_limit_ends_an_episode_and_is_not_terminal() {
    let mut environment = environment(2);
    for step in 1..=250 {
        let outcome = environment.step(&[0.0]).unwrap();
        assert!(!outcome.terminal);
        assert_eq!(outcome.last, step == 250, "step {step}");
    }
    assert!(matches!(environment.step(&[0.0]), Err(Error::EpisodeOver { steps: 250 })));
    environment.reset().unwrap();
    environment.step(&[0.0]).unwrap();
}

#[test]
fn the_frame_shows_the_agent_and_every_pixel_and_nothing_else() {
    let mut environment = grid(6, &[(2, 4, 1), (9, 0, 5)]);
    let frame = environment.frame().unwrap();
    assert_eq!(frame.dim(), (1, 35, 15));
    let lit: Vec<_> = frame.indexed_iter().filter(|(_, value)| **value != 0).collect();
    let expected = [((0, 0, 9), &LIT), ((0, 4, 2), &LIT), ((0, 34, 6), &LIT)];
    assert_eq!(lit, expected);
}

#[test]
fn readings_say_where_everything_is() {
    let environment = grid(6, &[(2, 4, 1), (9, 0, 5)]);
    let spec: Vec<_> = environment.spec.readings.iter().map(|r| (&*r.name, r.len)).collect();
    assert_eq!(spec, [("agent_column", 1), ("pixel_row", 15)]);
    let readings = environment.readings();
    assert_eq!(readings[0], [6.0]);
    let mut rows = vec![-1.0; 15];
    (rows[2], rows[9]) = (4.0, 0.0);
    assert_eq!(readings[1], rows);
}

#[test]
fn faulty_calls_and_settings_are_named() {
    let rng = || ChaCha8Rng::seed_from_u64(0);
    let mut fresh = FallingPixels::new(&SETTINGS, rng()).unwrap();
    assert!(matches!(fresh.step(&[0.0]), Err(Error::NotReset { .. })));
    assert!(matches!(fresh.frame(), Err(Error::NotReset { .. })));
    fresh.reset().unwrap();
    assert!(matches!(fresh.step(&[]), Err(Error::ActionLength { expected: 1, got: 0, .. })));
    assert!(matches!(fresh.step(&[0.0, 0.0]), Err(Error::ActionLength { got: 2, .. })));
    for value in [f32::NAN, f32::INFINITY] {
        assert!(matches!(fresh.step(&[value]), Err(Error::ActionNotFinite { index: 0, .. })));
    }
    for (settings, name) in [
        (Settings { height: 1, ..SETTINGS }, "height"),
        (Settings { width: 0, ..SETTINGS }, "width"),
        (Settings { episode_steps: 0, ..SETTINGS }, "episode_steps"),
    ] {
        let message = FallingPixels::new(&settings, rng()).unwrap_err().to_string();
        assert!(message.contains(name) && message.contains("at least"), "{message}");
    }
}

/// Actions that depend on nothing but the step.
fn action(step: usize) -> [f32; 1] {
    [((step * 7 + 3) % 11) as f32 / 5.0 - 1.0]
}

fn play(environment: &mut FallingPixels, steps: usize) -> Vec<(f64, Vec<Vec<f64>>, Array3<u8>)> {
    (0..steps)
        .map(|step| {
            let outcome = environment.step(&action(step)).unwrap();
            if outcome.last {
                environment.reset().unwrap();
            }
            (outcome.reward, environment.readings(), environment.frame().unwrap())
        })
        .collect()
}

#[test]
fn the_same_seed_plays_the_same_episodes_and_another_does_not() {
    let first = play(&mut environment(3), 600);
    assert!(first == play(&mut environment(3), 600));
    assert!(first != play(&mut environment(4), 600));
}

#[test]
fn a_restored_snapshot_goes_on_bit_for_bit() {
    let mut environment = environment(8);
    play(&mut environment, 333);
    let text = environment.snapshot().unwrap().to_string();
    let expected = play(&mut environment, 400);
    let mut other = FallingPixels::new(&SETTINGS, ChaCha8Rng::seed_from_u64(99)).unwrap();
    other.restore(&serde_json::from_str(&text).unwrap()).unwrap();
    assert!(play(&mut other, 400) == expected);
}

#[test]
fn a_snapshot_that_does_not_fit_is_refused() {
    let environment = environment(8);
    let snapshot = environment.snapshot().unwrap();
    let narrow = Settings { width: 14, ..SETTINGS };
    let mut other = FallingPixels::new(&narrow, ChaCha8Rng::seed_from_u64(0)).unwrap();
    assert!(other.restore(&snapshot).unwrap_err().to_string().contains("width"));
    let short = Settings { episode_steps: 7, ..SETTINGS };
    let mut played = environment.clone();
    play(&mut played, 8);
    let mut other = FallingPixels::new(&short, ChaCha8Rng::seed_from_u64(0)).unwrap();
    let error = other.restore(&played.snapshot().unwrap()).unwrap_err().to_string();
    assert!(error.contains("8 steps into an episode, and these have 7"), "{error}");
    let mut damaged = snapshot.clone();
    damaged["pixels"][3]["row"] = 35.into();
    assert!(environment.clone().restore(&damaged).is_err());
    assert!(environment.clone().restore(&Value::Null).is_err());
}

/// Mean return of a policy over 300 episodes with one continuing stream of this seed.
fn mean_return(seed: u64, mut policy: impl FnMut() -> f32) -> f64 {
    let episodes = 300;
    let mut environment = environment(seed);
    let mut total = 0.0;
    for _ in 0..episodes {
        environment.reset().unwrap();
        loop {
            let step = environment.step(&[policy()]).unwrap();
            total += step.reward;
            if step.last {
                break;
            }
        }
    }
    total / f64::from(episodes)
}

/// 20,000 episodes elsewhere gave 4.79 ± 1.96 and 4.81 ± 1.45: the mean of 300 deviates by 0.11.
#[test]
fn random_and_idle_play_are_worth_what_the_specification_says() {
    let mut rng = ChaCha8Rng::seed_from_u64(2024);
    let random = mean_return(10, || rng.random_range(-1.0..=1.0));
    let idle = mean_return(11, || 0.0);
    println!("uniform random {random:.2} (seeds 10, 2024), standing still {idle:.2} (seed 11)");
    assert!((random - 4.8).abs() <= 0.5, "uniform random: {random}");
    assert!((idle - 4.8).abs() <= 0.5, "standing still: {idle}");
}
