//! Operators other than the default, and what they are applied to.

use chladni::cloud::reader::Format;
use chladni::cloud::writer::npy_vector_header;
use chladni::cloud::{PointCloud, ScalarType};
use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::service::{Service, detail, file, problem, sphere, sphere_and};

const POINTS: usize = 500;

async fn apply(service: &Service, id: &str, functions: &Value) -> Value {
    let response = service.post(&format!("/jobs/{id}/laplacian"), functions.to_string()).await;
    assert_eq!(response.status(), StatusCode::OK);
    response.json().await.unwrap()
}

fn column(cloud: &PointCloud, axis: usize) -> Vec<f64> {
    (0..cloud.len()).map(|i| cloud.point(i)[axis]).collect()
}

#[tokio::test]
async fn the_laplacian_of_a_coordinate_of_the_sphere_is_minus_twice_the_coordinate() {
    let service = Service::start().await;
    let cloud = sphere(POINTS);
    let id = service.succeed("kind=operator", file(&cloud, Format::Ply)).await;
    let z = column(&cloud, 2);
    let answer = apply(&service, &id, &json!({ "z": z, "one": vec![1.0; POINTS] })).await;
    assert_eq!(answer["points"], POINTS);
    let found = answer["fields"]["z"].as_array().unwrap();
    let (mut error, mut size) = (0.0, 0.0);
    for (found, z) in found.iter().zip(&z) {
        error += (found.as_f64().unwrap() + 2.0 * z).powi(2);
        size += 4.0 * z * z;
    }
    assert!((error / size).sqrt() < 0.05, "{}", (error / size).sqrt());
    assert!(answer["fields"]["one"].as_array().unwrap().iter().all(|x| x.as_f64().unwrap().abs() < 1e-9));

    let mut body = npy_vector_header(POINTS, ScalarType::Float64);
    body.extend(z.iter().flat_map(|x| x.to_le_bytes()));
    let request = service.client.post(service.url(&format!("/jobs/{id}/laplacian?format=npy"))).body(body);
    let bytes = request.send().await.unwrap().bytes().await.unwrap();
    let array = npyz::NpyFile::new(&bytes[..]).unwrap();
    assert_eq!(array.shape(), [POINTS as u64, 1]);
    let values: Vec<f64> = array.into_vec().unwrap();
    assert!(values.iter().zip(found).all(|(a, b)| a.to_bits() == b.as_f64().unwrap().to_bits()));
}

#[tokio::test]
async fn repeated_rows_have_the_laplacian_of_their_first_occurrence_also_where_they_lie_a_little_beside_it() {
    let service = Service::start().await;
    let cloud = sphere(POINTS);
    let seventh = [cloud.point(7)[0], cloud.point(7)[1], cloud.point(7)[2]];
    let beside = seventh.map(|x| x * (1.0 + 1e-5));
    let id = service.succeed("kind=operator", sphere_and(POINTS, &[seventh, beside])).await;
    let mut z = column(&cloud, 2);
    z.extend([1e9, 1e9]);
    let answer = apply(&service, &id, &json!([z])).await;
    let found = answer["fields"]["f0"].as_array().unwrap();
    assert!(found[7].is_number());
    assert_eq!(found[POINTS..], [found[7].clone(), found[7].clone()]);
    assert!(found[7].as_f64().unwrap().abs() < 10.0);
}

#[tokio::test]
async fn functions_of_the_wrong_length_and_jobs_without_q_are_refused() {
    let service = Service::start().await;
    let id = service.succeed("kind=operator", file(&sphere(POINTS), Format::Ply)).await;
    let response = service.post(&format!("/jobs/{id}/laplacian"), "[1, 2]").await;
    let refused = problem(response, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
    assert!(detail(&refused).contains("2 values; the upload has 500 rows"), "{refused}");
    let eigen = service.succeed("bases=4", file(&sphere(POINTS), Format::Ply)).await;
    let response = service.post(&format!("/jobs/{eigen}/laplacian"), "[1]").await;
    let refused = problem(response, StatusCode::CONFLICT, "no-such-result").await;
    assert!(detail(&refused).contains("\"kind\": \"operator\""), "{refused}");
}

#[tokio::test]
async fn every_operator_can_be_asked_for_by_name_on_a_cloud_with_faces() {
    let service = Service::start().await;
    // the faces of a coarse sphere: rings of a grid
    let request = chladni::cloud::shapes::SampleRequest {
        sampling: chladni::cloud::shapes::Sampling::Grid,
        ..chladni::cloud::shapes::SampleRequest::new(chladni::cloud::shapes::Shape::Sphere, POINTS)
    };
    let cloud = chladni::cloud::shapes::sample(&request).unwrap();
    for kind in chladni::operator::OperatorKind::ALL {
        let name = kind.name();
        let id = service.succeed(&format!("operator={name}&bases=6"), file(&cloud, Format::Ply)).await;
        let spectrum = service.json(&format!("/jobs/{id}/spectrum")).await;
        assert_eq!(spectrum["eigenvalues"].as_array().unwrap().len(), 6, "{name}");
        assert_eq!(spectrum.get("imaginary_parts").is_some(), name == "pcd");
        let job = service.json(&format!("/jobs/{id}")).await;
        assert_eq!(job["parameters"]["operator"], name);
    }
}

#[tokio::test]
async fn an_operator_on_faces_or_in_too_many_dimensions_is_refused_with_what_is_missing() {
    let service = Service::start().await;
    for (query, told) in [
        ("operator=mesh", "needs the faces of a mesh"),
        ("operator=cotangent&kind=operator", "needs the faces of a mesh"),
        ("operator=mesh&dimension=3", "must be 2"),
        ("distance=projected", "applies to the operators `pcd`"),
    ] {
        let response = service.post(&format!("/clouds?{query}"), file(&sphere(POINTS), Format::Ply)).await;
        assert_eq!(response.status(), StatusCode::UNPROCESSABLE_ENTITY, "{query}");
        let refused: Value = response.json().await.unwrap();
        assert!(detail(&refused).contains(told), "{query}: {refused}");
    }
    let flat: Vec<u8> = (0..100).flat_map(|i| format!("{} {} 1\n", i % 10, i / 10).into_bytes()).collect();
    let response = service.post("/clouds?format=xyz&dimension=3", flat).await;
    assert_eq!(response.status(), StatusCode::UNPROCESSABLE_ENTITY);
    let refused: Value = response.json().await.unwrap();
    assert!(detail(&refused).contains("on a plane"), "{refused}");
}
