use ndarray::{Array, IxDyn};
use rand_chacha::rand_core::SeedableRng;

use super::*;
use crate::{ActionRepeat, FrameShape};

fn images(shape: &[usize]) -> Space {
    let (dtype, shape) = ("uint8".to_owned(), shape.to_vec());
    Space::Box { dtype, shape, low: vec![0.0], high: vec![255.0] }
}

fn actions(low: &[f64], high: &[f64]) -> Space {
    let (dtype, shape) = ("float32".to_owned(), vec![low.len()]);
    Space::Box { dtype, shape, low: low.to_vec(), high: high.to_vec() }
}

fn interface(observation: Space, action: Space) -> Result<Interface, Error> {
    Interface::new(&Declaration { task: "walk".to_owned(), observation, action })
}

fn usual() -> Interface {
    interface(images(&[16, 20, 3]), actions(&[-2.0, 0.0], &[2.0, 1.0])).unwrap()
}

/// Counts its steps; ends as told.
struct Counter {
    steps: usize,
    seeds: std::rc::Rc<std::cell::RefCell<Vec<u32>>>,
    end: fn(usize) -> (bool, bool),
    reward: fn(usize) -> f64,
    side: fn(usize) -> usize,
}

impl Counter {
    fn new() -> Self {
        Self {
            steps: 0,
            seeds: Default::default(),
            end: |_| (false, false),
            reward: |_| 1.0,
            side: |_| 16,
        }
    }

    fn scene(&self) -> Scene {
        let frame = Array3::from_elem((3, (self.side)(self.steps), 20), self.steps as u8);
        Scene { frame, readings: vec![vec![self.steps as f64], vec![1.0, 2.0]] }
    }
}

impl Simulator for Counter {
    fn reset(&mut self, seed: u32) -> Result<Scene, Error> {
        self.seeds.borrow_mut().push(seed);
        self.steps = 0;
        Ok(self.scene())
    }

    fn step(&mut self, _: &[f64]) -> Result<Outcome, Error> {
        self.steps += 1;
        let (terminated, truncated) = (self.end)(self.steps);
        Ok(Outcome {
            scene: self.scene(),
            reward: (self.reward)(self.steps),
            terminated,
            truncated,
        })
    }
}

fn external(counter: Counter, limit: usize, readings: &[&str]) -> External {
    let readings: Vec<String> = readings.iter().map(|name| (*name).to_owned()).collect();
    let rng = ChaCha8Rng::seed_from_u64(5);
    External::new(usual(), Box::new(counter), limit, &readings, rng).unwrap()
}

#[test]
fn channels_are_found_and_moved_to_the_front() {
    for (shape, dim) in [
        (&[16, 20, 3][..], (3, 16, 20)),
        (&[3, 16, 20], (3, 16, 20)),
        (&[16, 20, 1], (1, 16, 20)),
        (&[16, 20], (1, 16, 20)),
    ] {
        let interface = interface(images(shape), actions(&[-1.0], &[1.0])).unwrap();
        assert_eq!(interface.frame.dim(), dim, "{shape:?}");
        assert_eq!(interface.frame_shape(), shape);
        // Each pixel says where it is, in the program's own order.
        let frame = Array::from_shape_fn(IxDyn(shape), |index| (index[0] * 20 + index[1]) as u8);
        let moved = interface.frame(frame.view()).unwrap();
        assert_eq!(moved.dim(), dim);
        let expected = |(c, y, x)| if shape[0] == 3 { c * 20 + y } else { y * 20 + x };
        assert!(moved.indexed_iter().all(|(index, &pixel)| pixel == expected(index) as u8));
        let wrong = interface.frame(ndarray::ArrayViewD::from_shape(IxDyn(&[1, 1]), &[0]).unwrap());
        assert!(matches!(wrong, Err(Error::ExternalFrame { .. })), "{shape:?}");
    }
}

#[test]
fn actions_are_scaled_to_their_bounds_and_back() {
    let interface = usual();
    assert_eq!(interface.action(&[-1.0, 1.0]), [-2.0, 1.0]);
    assert_eq!(interface.action(&[0.5, 0.0]), [1.0, 0.5]);
    assert_eq!(interface.scaled(&[1.0, 0.5]), [0.5, 0.0]);
}

#[test]
fn unsuitable_spaces_are_refused_with_a_way_out() {
    let action = || actions(&[-1.0], &[1.0]);
    let floats = Space::Box {
        dtype: "float32".to_owned(),
        shape: vec![84, 84, 3],
        low: vec![0.0],
        high: vec![1.0],
    };
    let integers =
        Space::Box { dtype: "int64".to_owned(), shape: vec![1], low: vec![0.0], high: vec![3.0] };
    for (observation, action, words) in [
        (
            images(&[84, 84, 3]),
            Space::Other("Discrete(2)".into()),
            "action space of walk is Discrete(2)",
        ),
        (images(&[84, 84, 3]), integers, "Box of int64"),
        (images(&[84, 84, 3]), actions(&[f64::NEG_INFINITY], &[1.0]), "RescaleAction"),
        (images(&[84, 84, 3]), actions(&[1.0], &[1.0]), "below the upper bound"),
        (images(&[84, 84, 3]), actions(&[], &[]), "at least one number"),
        (images(&[4]), action(), "AddRenderObservation"),
        (Space::Other("Dict(…)".into()), action(), "a Box of images"),
        (images(&[84, 84, 9]), action(), "leave frame stacking to hksl"),
        (images(&[84, 14, 3]), action(), "ResizeObservation"),
        (floats, action(), "TransformObservation"),
    ] {
        let message = interface(observation, action).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn termination_is_terminal_and_truncation_is_not() {
    let mut counter = Counter::new();
    counter.end = |n| (n == 3, false);
    let mut task = external(counter, 5, &[]);
    task.reset().unwrap();
    let steps: Vec<Step> = (0..3).map(|_| task.step(&[0.0, 0.0]).unwrap()).collect();
    assert_eq!(steps[1], Step { reward: 1.0, terminal: false, last: false });
    assert_eq!(steps[2], Step { reward: 1.0, terminal: true, last: true });
    assert!(matches!(task.step(&[0.0, 0.0]), Err(Error::EpisodeOver { steps: 3 })));

    let mut counter = Counter::new();
    counter.end = |n| (false, n == 3);
    let mut task = external(counter, 5, &[]);
    task.reset().unwrap();
    let last = (0..3).map(|_| task.step(&[0.0, 0.0]).unwrap()).last().unwrap();
    assert_eq!(last, Step { reward: 1.0, terminal: false, last: true });
}

#[test]
fn the_time_limit_truncates() {
    let mut task = ActionRepeat::new(Box::new(external(Counter::new(), 6, &[])), 4).unwrap();
    task.reset().unwrap();
    assert!(!task.step(&[0.0, 0.0]).unwrap().last);
    let last = task.step(&[0.0, 0.0]).unwrap();
    assert_eq!(last, Step { reward: 2.0, terminal: false, last: true });
}

#[test]
fn what_must_not_be_is_an_error_and_ends_the_episode() {
    let mut nan = Counter::new();
    nan.reward = |n| if n == 2 { f64::NAN } else { 0.0 };
    let mut grows = Counter::new();
    grows.side = |n| if n == 2 { 17 } else { 16 };
    for (counter, words) in [(nan, "reward NaN in step 2"), (grows, "shape [3, 17, 20]")] {
        let mut task = external(counter, 5, &[]);
        task.reset().unwrap();
        task.step(&[0.0, 0.0]).unwrap();
        let error = task.step(&[0.0, 0.0]).unwrap_err();
        assert!(error.is_external() && error.to_string().contains(words), "{error}");
        assert!(matches!(task.step(&[0.0, 0.0]), Err(Error::NotReset { .. })));
        assert!(task.reset().is_ok());
    }
}

#[test]
fn episodes_have_seeds_of_their_own_which_a_snapshot_continues() {
    let counter = Counter::new();
    let seeds = counter.seeds.clone();
    let mut task = external(counter, 5, &["count", "pair"]);
    assert_eq!(task.spec().readings[1].len, 2);
    task.reset().unwrap();
    let snapshot = task.snapshot().unwrap();
    task.reset().unwrap();
    // Once to learn the readings' sizes, with the seed of the first episode.
    let first = seeds.borrow().clone();
    assert!(first[0] == first[1] && first[1] != first[2] && first[2] < 1 << 31);
    assert_eq!(task.readings(), [vec![0.0], vec![1.0, 2.0]]);

    let counter = Counter::new();
    let seeds = counter.seeds.clone();
    let mut resumed = external(counter, 5, &[]);
    assert!(!resumed.restores_episodes());
    resumed.restore(&snapshot).unwrap();
    assert!(matches!(resumed.step(&[0.0, 0.0]), Err(Error::NotReset { .. })));
    resumed.reset().unwrap();
    assert_eq!(*seeds.borrow(), first[2..]);
    assert_eq!(resumed.spec().frame, FrameShape { channels: 3, height: 16, width: 20 });
}
