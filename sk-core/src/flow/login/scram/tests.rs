//! The example of RFC 7677, and what must hold for whatever a peer sends.

use super::message::{ClientFirst, ServerFirst};
use super::*;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use proptest::prelude::*;

const CLIENT_NONCE: &str = "rOprNGfwEbeRWgbNEkqO";
const SERVER_FIRST: &str =
    "r=rOprNGfwEbeRWgbNEkqO%hvYDpWUa2RaTCAfuxFIlj)hNlF$k0,s=W22ZaJ0SNY7soEsUEjb6gQ==,i=4096";

fn few_rounds(password: &str, rounds: u32) -> ClientKeys {
    ClientKeys::derive(&Password::new(password), [7; 16], rounds)
}

#[test]
fn the_example_of_rfc_7677_comes_out() {
    let mut client = ClientExchange::with_nonce("user", CLIENT_NONCE.to_owned());
    assert_eq!(client.first(), "n,,n=user,r=rOprNGfwEbeRWgbNEkqO");
    client.challenged_with_any_rounds(SERVER_FIRST);
    let challenge = ServerFirst::read(SERVER_FIRST).expect("well formed");
    let keys = ClientKeys::derive(&Password::new("pencil"), challenge.salt, challenge.rounds);
    let last = client.last(&keys).expect("an answer to this login");
    assert_eq!(
        last,
        "c=biws,r=rOprNGfwEbeRWgbNEkqO%hvYDpWUa2RaTCAfuxFIlj)hNlF$k0,p=dHzbZapWIk4jUhN+Ute9ytag9zjfMHgsqmmiz7AndVQ="
    );
    let signature = STANDARD.decode("6rriTRBi23WpRR/wtup+mMhUZUn/dB5nLTJRsjl95G4=").expect("base64");
    assert!(client.hub_is_true(&signature.try_into().expect("32 bytes")));
    assert_eq!(challenge.text(), SERVER_FIRST);
}

/// One login; what the hub answers, and whether the client believes it.
fn log_in(known: &str, user: &str, password: &str) -> (Result<(), ScramError>, bool) {
    let verifier = few_rounds(known, 2).verifier();
    let find = |user: &str| (user == "ada").then(|| verifier.clone());
    let mut client = ClientExchange::new(user, &[1; 32]);
    let hub = ServerExchange::begin(&client.first(), &[2; 32], &[3; 32], &find).expect("well formed");
    client.challenged_with_any_rounds(hub.challenge());
    let challenge = ServerFirst::read(hub.challenge()).expect("well formed");
    let rounds = challenge.rounds.min(2);
    let keys = ClientKeys::derive(&Password::new(password), challenge.salt, rounds);
    let proof = hub.finish(&client.last(&keys).expect("an answer to this login"));
    let believed = proof.as_ref().is_ok_and(|proof| client.hub_is_true(proof));
    (proof.map(drop), believed)
}

#[test]
fn the_right_password_logs_in_and_no_other_does() {
    assert_eq!(log_in("pencil", "ada", "pencil"), (Ok(()), true));
    for (user, password) in [("ada", "Pencil"), ("ada", ""), ("bob", "pencil"), ("ada ", "pencil")] {
        assert_eq!(log_in("pencil", user, password), (Err(ScramError::Proof), false), "{user} {password}");
    }
}

#[test]
fn a_hub_that_does_not_know_the_account_is_not_believed() {
    let mut client = ClientExchange::with_nonce("user", CLIENT_NONCE.to_owned());
    assert!(!client.hub_is_true(&[0; 32]), "before anything was proved");
    client.challenged_with_any_rounds(SERVER_FIRST);
    client.last(&few_rounds("pencil", 1)).expect("an answer to this login");
    assert!(!client.hub_is_true(&[0; 32]));
}

#[test]
fn nobodys_challenge_looks_like_any_other_and_is_the_same_tomorrow() {
    let challenge = |user: &str, random: [u8; 32]| {
        let verifier = few_rounds("pencil", ROUNDS_MIN).verifier();
        let find = |user: &str| (user == "ada").then(|| verifier.clone());
        let first = ClientExchange::new(user, &[1; 32]).first();
        ServerExchange::begin(&first, &random, &[3; 32], &find)
            .expect("well formed")
            .challenge()
            .to_owned()
    };
    let [known, bob, carl] = ["ada", "bob", "carl"].map(|user| challenge(user, [2; 32]));
    assert_eq!(known.len(), bob.len());
    let salt = |text: &str| ServerFirst::read(text).expect("well formed").salt;
    assert_ne!(salt(&bob), salt(&carl));
    assert_eq!(salt(&bob), salt(&challenge("bob", [9; 32])));
    assert_ne!(bob, challenge("bob", [9; 32]), "the random number is another one");
}

#[test]
fn a_proof_is_void_in_another_login() {
    let verifier = few_rounds("pencil", 2).verifier();
    let find = |_: &str| Some(verifier.clone());
    let mut client = ClientExchange::new("ada", &[1; 32]);
    let begin = |random: [u8; 32]| {
        ServerExchange::begin("n,,n=ada,r=AQEBAQEBAQEBAQEBAQEBAQEBAQEBAQEB", &random, &[3; 32], &find)
            .expect("well formed")
    };
    let (first, second) = (begin([2; 32]), begin([4; 32]));
    client.challenged_with_any_rounds(first.challenge());
    let last = client.last(&few_rounds("pencil", 2)).expect("an answer to this login");
    assert!(first.finish(&last).is_ok());
    assert_eq!(second.finish(&last), Err(ScramError::Nonce));
}

#[test]
fn a_client_leaves_a_hub_that_asks_for_too_few_or_too_many_rounds_or_another_login() {
    for (rounds, good) in [
        (ROUNDS_MIN - 1, false),
        (ROUNDS_MIN, true),
        (ROUNDS_MAX, true),
        (ROUNDS_MAX + 1, false),
        (u32::MAX, false),
    ] {
        let mut client = ClientExchange::new("ada", &[1; 32]);
        let text = ServerFirst { nonce: "x", salt: [7; 16], rounds }.text();
        let found = client.challenged(&text, Password::new("pencil"));
        assert_eq!(found.is_ok(), good, "{rounds}");
        if good {
            assert_eq!(client.last(&few_rounds("pencil", 1)), Err(ScramError::Nonce));
        }
        assert_eq!(Verifier::new(rounds, [7; 16], [1; 32], [2; 32]).is_some(), good, "{rounds}");
    }
}

#[test]
fn what_does_not_follow_the_grammar_is_refused() {
    for bad in [
        "",
        "n,,",
        "n=ada,r=x",
        "p=tls-unique,,n=ada,r=x",
        "n,a=bob,n=ada,r=x",
        "n,,m=x,n=ada,r=x",
        "n,,n=ada,r=",
        "n,,n=ada,r=a b",
        "n,,r=x,n=ada",
        "n,,n=ada,r=x,e=1",
    ] {
        assert!(ClientFirst::read(bad).is_err(), "{bad:?}");
    }
    for bad in ["", "r=x", "r=x,s=,i=4096", "r=x,s=AAAA,i=4096", "e=unknown-user"] {
        assert!(ServerFirst::read(bad).is_err(), "{bad:?}");
    }
    for rounds in ["", "+4096", "-1", "04096", "4096,", "99999999999", "4e3", "0"] {
        assert!(
            ServerFirst::read(&format!("r=x,s=W22ZaJ0SNY7soEsUEjb6gQ==,i={rounds}")).is_err(),
            "{rounds}"
        );
    }
}

#[test]
fn what_is_kept_reads_back_and_nothing_else_does() {
    let verifier = few_rounds("pencil", ROUNDS_MIN).verifier();
    let kept = verifier.variant();
    assert_eq!(Verifier::from_variant(&kept), Some(verifier));
    let map = kept.as_map().expect("a map");
    for key in map.keys() {
        let mut less = map.clone();
        less.remove(key);
        assert_eq!(Verifier::from_variant(&less.clone().into()), None, "without {key}");
        less.insert(key.to_string(), 1.into());
        assert_eq!(Verifier::from_variant(&less.into()), None, "{key} is 1");
    }
    let mut more = map.clone();
    more.insert("x".to_owned(), 1.into());
    assert_eq!(Verifier::from_variant(&more.into()), None);
}

#[test]
fn nothing_secret_is_printed() {
    let keys = few_rounds("pencil", 1);
    let exchange = ClientExchange::new("ada", &[1; 32]);
    let printed = format!("{:?} {:?} {:?} {exchange:?}", Password::new("pencil"), keys, keys.verifier());
    assert_eq!(printed, "Password(secret) ClientKeys(secret) Verifier(secret) ClientExchange(secret)");
}

proptest! {
    #[test]
    fn whatever_a_client_sends_is_an_error_or_a_refusal(first in ".{0,80}", last in ".{0,120}") {
        let find = |_: &str| None;
        for first in [first.as_str(), "n,,n=ada,r=x"] {
            if let Ok(hub) = ServerExchange::begin(first, &[2; 32], &[3; 32], &find) {
                prop_assert!(hub.finish(&last).is_err());
            }
        }
    }

    #[test]
    fn whatever_a_hub_sends_is_an_error_or_a_challenge(challenge in ".{0,120}") {
        let mut client = ClientExchange::new("ada", &[1; 32]);
        if client.challenged(&challenge, Password::new("x")).is_ok() {
            // A hub that does not repeat the client's random number is left.
            let answered = client.last(&few_rounds("x", 1)).is_ok();
            prop_assert_eq!(answered, challenge.contains(&ClientExchange::new("ada", &[1; 32]).first()[10..]));
        }
    }

    #[test]
    fn no_bit_of_a_proof_may_turn(bit in 0_usize..256, random: [u8; 32]) {
        let verifier = few_rounds("pencil", 1).verifier();
        let find = |_: &str| Some(verifier.clone());
        let mut client = ClientExchange::new("ada", &random);
        let hub = ServerExchange::begin(&client.first(), &[2; 32], &[3; 32], &find).expect("well formed");
        client.challenged_with_any_rounds(hub.challenge());
        let last = client.last(&few_rounds("pencil", 1)).expect("an answer");
        let (before, proof) = last.rsplit_once("p=").expect("a proof");
        let mut proof = STANDARD.decode(proof).expect("base64");
        proof[bit / 8] ^= 1 << (bit % 8);
        prop_assert_eq!(hub.finish(&format!("{before}p={}", STANDARD.encode(proof))), Err(ScramError::Proof));
    }
}

#[test]
fn a_client_that_is_told_there_is_no_binding_where_there_is_one_has_been_lied_to() {
    let keys = ClientKeys::derive(&Password::new("pencil"), [7; 16], ROUNDS_MIN);
    let find = |_: &str| Some(keys.verifier());
    let binding = [5; 32];
    for (header, on, expected) in [
        ("n,,", None, true),
        ("n,,", Some(&binding), true),
        ("y,,", None, true),
        ("y,,", Some(&binding), false),
    ] {
        let client = ClientExchange::new("ada", &[1; 32]);
        let first = client.first().replacen("n,,", header, 1);
        let hub = ServerExchange::begin(&first, &[2; 32], &[3; 32], &find).expect("a first message");
        assert!(!hub.is_bound());
        let challenge = super::message::ServerFirst::read(hub.challenge()).expect("its own");
        let without = super::message::ClientFinal::without_proof(header.as_bytes(), challenge.nonce);
        let bare = first.strip_prefix(header).expect("its own header");
        let login = super::message::auth_message(bare, hub.challenge(), &without);
        let last = super::message::ClientFinal::text(&without, &keys.proof(&login));
        assert_eq!(hub.finish_on(&last, on).is_ok(), expected, "{header} {on:?}");
    }
}
