//! What every method's agent saves is a copy, and all that it goes on from.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use hksl_envs::{FrameShape, Spec};
use hksl_sac::{Acting, Agent, RecurrentState};
use hksl_train::agent;
use hksl_train::config::{Request, methods, resolve};
use ndarray::Array3;

fn small(method: &str, sets: &[&str]) -> Agent {
    let request = Request {
        task: Some("falling-pixels".to_owned()),
        method: Some(method.to_owned()),
        presets: vec!["debug".to_owned()],
        sets: sets.iter().map(ToString::to_string).collect(),
        ..Request::default()
    };
    let config = resolve(&request).unwrap().config;
    let spec = Spec {
        task: "falling-pixels".to_owned(),
        frame: FrameShape { channels: 1, height: 35, width: 15 },
        action_dims: 1,
        steps_per_episode: 20,
        readings: Vec::new(),
    };
    agent(&config, &spec, &Device::Cpu).unwrap()
}

/// Two episodes whose pictures and rewards differ from step to step.
fn live(agent: &mut Agent) {
    let frame = |step: u8| Array3::from_shape_fn((1, 35, 15), |(_, i, j)| step ^ (7 * i + j) as u8);
    for episode in 0..2u8 {
        agent.begin_episode(frame(episode).view()).unwrap();
        for step in 0..20 {
            let action = [f32::from(step) / 10.0 - 1.0];
            let seen = frame(100 * episode + step + 1);
            agent.observe(&action, f64::from(step % 3), false, seen.view()).unwrap();
        }
        agent.end_episode();
    }
}

fn learn(agent: &mut Agent, steps: std::ops::Range<u64>) {
    while agent.pretrain().unwrap().is_some() {}
    for step in steps {
        agent.update(step).unwrap().unwrap();
    }
}

fn bits(tensors: &BTreeMap<String, Tensor>) -> BTreeMap<String, Vec<u64>> {
    let bits = |tensor: &Tensor| {
        let numbers = tensor.flatten_all().unwrap().to_dtype(candle_core::DType::F64).unwrap();
        numbers.to_vec1::<f64>().unwrap().into_iter().map(f64::to_bits).collect()
    };
    tensors.iter().map(|(name, tensor)| (name.clone(), bits(tensor))).collect()
}

#[test]
fn an_agent_goes_back_to_what_it_saved_and_learns_the_same_again() {
    let cases = methods().into_iter().map(|method| (method, &[] as &[&str]));
    for (method, sets) in cases.chain([("hksl", &["hksl.update_schedule=joint"] as &[&str])]) {
        let mut agent = small(method, sets);
        live(&mut agent);
        learn(&mut agent, 0..3);
        let (saved, weights) = (agent.save().unwrap(), agent.networks().weights().unwrap());
        let then = (bits(&saved.tensors), bits(&weights));
        learn(&mut agent, 3..6);
        let later = bits(&agent.save().unwrap().tensors);
        assert_eq!((bits(&saved.tensors), bits(&weights)), then, "{method}: what was saved moved");
        assert_ne!(later, then.0, "{method} learns nothing");
        agent.load(saved).unwrap();
        learn(&mut agent, 3..6);
        assert!(bits(&agent.save().unwrap().tensors) == later, "{method} learns otherwise");
    }
}

#[test]
fn a_state_that_does_not_fit_changes_nothing() {
    for method in methods() {
        let mut agent = small(method, &[]);
        live(&mut agent);
        let saved = agent.save().unwrap();
        learn(&mut agent, 0..3);
        let before = bits(&agent.save().unwrap().tensors);
        let number = Tensor::new(&[0f32], &Device::Cpu).unwrap();
        let moment = saved.tensors.keys().find(|name| name.ends_with(".mean")).unwrap().clone();
        for name in ["moments.critic.7.x.mean", "weights.x", "x"] {
            let mut foreign = saved.clone();
            foreign.tensors.insert(name.to_owned(), number.clone());
            assert!(agent.load(foreign).is_err(), "{method} takes {name}");
        }
        let mut lacking = saved.clone();
        lacking.tensors.remove(&moment);
        assert!(agent.load(lacking).is_err(), "{method} does without {moment}");
        let mut foreign = saved.clone();
        let stream = foreign.rest.streams.values().next().unwrap().clone();
        foreign.rest.streams.insert("x".to_owned(), stream);
        assert!(agent.load(foreign).is_err(), "{method} takes another stream");
        assert!(bits(&agent.save().unwrap().tensors) == before, "{method} has changed");
        agent.load(saved).unwrap();
    }
}

#[test]
fn what_cannot_be_saved_is_not_stored() {
    let mut agent = small("sac", &[]);
    let frame = Array3::zeros((1, 35, 15));
    agent.begin_episode(frame.view()).unwrap();
    for (action, reward) in [(f32::NAN, 0.0), (0.0, f64::NAN), (0.0, 1e300)] {
        let message = agent.observe(&[action], reward, false, frame.view()).unwrap_err();
        assert!(message.to_string().contains("not a finite number"), "{message}");
    }
    assert_eq!(agent.replay().transitions(), 0);
    let observation = Array3::zeros((3, 35, 15));
    let acted = agent.act(observation.view(), Acting::Mean, &mut RecurrentState::default());
    assert_eq!(acted.unwrap().len(), 1);
}
