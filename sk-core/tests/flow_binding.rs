//! Logins that are bound to an encrypted connection: they are worth nothing on another one.

use sk_core::flow::login::OwnerToken;
use sk_core::flow::satellite::{Credentials, PasswordLogin, SatelliteCore};
use sk_core::flow::scram::{ClientKeys, Password, ROUNDS_MIN};
use sk_core::flow::server::{Origin, ServerCore, Settings};
use sk_flat::Instant;

const PEER: Origin = Origin::Line;

fn hub() -> ServerCore {
    let token = Some(OwnerToken::new([7; 32]));
    let settings = Settings { user: "robot".parse().expect("a name"), token, owner_uid: None };
    let mut hub = ServerCore::new(settings, Instant::ZERO);
    let keys = ClientKeys::derive(&Password::new("pencil"), [7; 16], ROUNDS_MIN);
    hub.add_account("ada".parse().expect("a name"), keys.verifier());
    hub
}

fn by_token() -> Credentials {
    Credentials::Token(OwnerToken::new([7; 32]))
}

fn by_password() -> Credentials {
    let ada = "ada".parse().expect("a name");
    Credentials::Password(PasswordLogin::new(ada, Password::new("pencil")))
}

/// Whether a login succeeds between two ends that know these bindings.
fn logs_in(
    hub: &mut ServerCore,
    credentials: Credentials,
    at_hub: Option<[u8; 32]>,
    here: Option<[u8; 32]>,
) -> bool {
    let id = hub.open(PEER, [1; 32], Instant::ZERO).expect("a place");
    let mut core = SatelliteCore::synchronous(credentials, [2; 32], Instant::ZERO);
    assert!(hub.is_unbound(id) && !core.has_greeted());
    if let Some(binding) = at_hub {
        hub.bind(id, binding);
    }
    if let Some(binding) = here {
        core.bind(binding);
    }
    for _ in 0..4 {
        while let Some(frame) = core.take() {
            hub.accept(id, frame, Instant::ZERO);
        }
        while let Some(frame) = hub.take(id) {
            core.accept(frame, Instant::ZERO).expect("an honest hub");
        }
        if let Some(derivation) = core.take_derivation() {
            core.derived(&derivation.run()).expect("a login is under way");
        }
    }
    let ready = core.is_ready();
    hub.left(id, Instant::ZERO);
    ready
}

#[test]
fn t17_a_login_that_is_passed_on_to_another_encrypted_connection_fails() {
    let (one, other) = (Some([5; 32]), Some([6; 32]));
    for credentials in [by_token(), by_password()] {
        let mut hub = hub();
        assert!(logs_in(&mut hub, credentials.clone(), one, one), "{credentials:?}");
        assert!(!logs_in(&mut hub, credentials.clone(), one, other), "{credentials:?}");
        assert!(
            !logs_in(&mut hub, credentials.clone(), None, one),
            "passed on in the clear: {credentials:?}"
        );
        assert!(logs_in(&mut hub, credentials.clone(), None, None), "{credentials:?}");
    }
}

#[test]
fn t17_who_cannot_bind_a_login_is_let_in_unless_the_hub_requires_it() {
    let binding = Some([5; 32]);
    for credentials in [by_token(), by_password()] {
        let mut hub = hub();
        assert!(logs_in(&mut hub, credentials.clone(), binding, None));
        hub.require_channel_binding(true);
        assert!(!logs_in(&mut hub, credentials.clone(), binding, None), "{credentials:?}");
        assert!(logs_in(&mut hub, credentials.clone(), binding, binding), "{credentials:?}");
        assert!(
            logs_in(&mut hub, credentials, None, None),
            "where nothing is encrypted there is nothing to bind to"
        );
    }
}
