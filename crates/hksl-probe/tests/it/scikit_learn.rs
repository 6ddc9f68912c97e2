//! Compares with stored results of scikit-learn (`fixtures/make.py`).

use hksl_probe::linear_probe::{Fit, LinearMap};
use hksl_probe::pca::pca;
use hksl_probe::silhouette::silhouette;
use ndarray::{Array1, Array2, Axis};
use serde::Deserialize;

#[derive(Deserialize)]
struct File {
    fixtures: Vec<Fixture>,
}

#[derive(Deserialize)]
struct Fixture {
    name: String,
    vectors: Vec<Vec<f64>>,
    labels: Vec<usize>,
    components: Vec<Vec<f64>>,
    explained_variance: Vec<f64>,
    explained_variance_ratio: Vec<f64>,
    projections: Vec<Vec<f64>>,
    silhouette: f64,
    targets: Vec<Vec<f64>>,
    penalty: f64,
    ridge_weights: Vec<Vec<f64>>,
    ridge_intercept: Vec<f64>,
}

fn fixtures() -> Vec<Fixture> {
    let file: File = serde_json::from_str(include_str!("../fixtures/scikit-learn.json")).unwrap();
    assert_eq!(file.fixtures.len(), 3);
    file.fixtures
}

fn matrix(rows: &[Vec<f64>]) -> Array2<f64> {
    Array2::from_shape_vec((rows.len(), rows[0].len()), rows.concat()).unwrap()
}

fn near(name: &str, what: &str, found: &Array2<f64>, expected: &Array2<f64>) {
    for (index, off) in (found - expected).indexed_iter() {
        assert!(off.abs() < 1e-8, "{name}: {what} differs by {off} at {index:?}");
    }
}

fn row(values: &[f64]) -> Array2<f64> {
    Array1::from_vec(values.to_vec()).insert_axis(Axis(0))
}

#[test]
fn principal_components_are_scikit_learns() {
    for fixture in fixtures() {
        let found = pca(matrix(&fixture.vectors).view(), 2).unwrap();
        let name = &fixture.name;
        near(name, "components", &found.components, &matrix(&fixture.components));
        near(name, "projections", &found.projections, &matrix(&fixture.projections));
        let variance = row(&found.explained_variance.to_vec());
        near(name, "variance", &variance, &row(&fixture.explained_variance));
        let ratio = row(&found.explained_variance_ratio.to_vec());
        near(name, "ratio", &ratio, &row(&fixture.explained_variance_ratio));
    }
}

#[test]
fn silhouettes_are_scikit_learns() {
    for fixture in fixtures() {
        let found = silhouette(matrix(&fixture.vectors).view(), &fixture.labels).unwrap();
        assert!((found - fixture.silhouette).abs() < 1e-8, "{}: {found}", fixture.name);
    }
}

#[test]
fn ridge_maps_are_scikit_learns() {
    for fixture in fixtures() {
        let (inputs, targets) = (matrix(&fixture.vectors), matrix(&fixture.targets));
        let fit = Fit::Ridge { penalty: fixture.penalty };
        let found = LinearMap::fit(inputs.view(), targets.view(), &fit).unwrap();
        near(&fixture.name, "weights", &found.weights, &matrix(&fixture.ridge_weights));
        let intercept = row(&found.intercept.to_vec());
        near(&fixture.name, "intercept", &intercept, &row(&fixture.ridge_intercept));
    }
}

#[test]
fn what_makes_no_sense_is_refused() {
    let one = Array2::zeros((1, 4));
    assert!(pca(one.view(), 1).unwrap_err().to_string().contains("1 vectors of 4"));
    assert!(pca(Array2::zeros((5, 1)).view(), 2).is_err());
    let same = pca(Array2::from_elem((5, 3), 2.5).view(), 2).unwrap();
    assert!(same.explained_variance_ratio.iter().chain(&same.projections).all(|&v| v == 0.0));
    assert!(silhouette(Array2::zeros((3, 1)).view(), &[0, 0, 0]).is_err());
    assert!(silhouette(Array2::zeros((3, 1)).view(), &[0, 1]).is_err());
    assert_eq!(silhouette(Array2::zeros((4, 1)).view(), &[0, 1, 0, 1]).unwrap(), 0.0);
}
